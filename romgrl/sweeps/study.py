"""Optuna's side of a search: its store, which is apart from MLflow's, what was tried, and what to try next.

How a trial ended is its state: COMPLETE with a number; PRUNED where its settings have none, because the training
diverged, the walker fell or they do not fit together, which Optuna ranks below every number; FAIL where something else
ended it. What failed or was interrupted is what the next search of that name begins with.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal

import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.exceptions import OptunaError
from optuna.study import Study
from optuna.trial import FrozenTrial, Trial, TrialState
from sqlalchemy.exc import SQLAlchemyError

from romgrl.cli.search_space import Scale
from romgrl.config.addresses import sqlite_address
from romgrl.config.values import refusal, show
from romgrl.errors import ConfigurationError, StorageError, one_line

STORE, NAME = "hydra.sweeper.storage", "hydra.sweeper.study_name"
SETTINGS, AGAIN = "settings", "again"  # attributes of a study, of a trial
Direction = Literal["minimize", "maximize"]
DONE = (TrialState.COMPLETE, TrialState.PRUNED)
ENDED = {TrialState.COMPLETE: "finished", TrialState.PRUNED: "no number", TrialState.FAIL: "failed"}


def open_study(store: Path, name: str, direction: Direction, settings: Mapping[str, Any]) -> Study:
    """The study of that name, made where there is none. `settings`: what all of its trials have in common.

    Raises ConfigurationError where the store is something else, or the study has other settings; StorageError.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    require_store(store)
    with store_faults(store):
        study = optuna.create_study(
            storage=sqlite_address(store), study_name=name, direction=direction, load_if_exists=True
        )
        settings = json.loads(json.dumps({"hydra.sweeper.direction": direction, **settings}))
        known = study.user_attrs.get(SETTINGS, settings)
        study.set_user_attr(SETTINGS, known)
    for key in sorted({*known, *settings}):
        if known.get(key) != settings.get(key):
            other = f"{key} = {show(known.get(key))}, not {show(settings.get(key))}"
            raise ConfigurationError(refusal(NAME, name, f"a new name; the search of this one has {other}"))
    return study


@contextmanager
def store_faults(store: Path) -> Iterator[None]:
    """Turn what goes wrong with the store while the block runs, as on a full disk, into a StorageError."""
    try:
        yield
    except (SQLAlchemyError, OptunaError) as error:
        raise StorageError(f"{store}: {one_line(str(error.__cause__ or error))}") from error


def require_store(path: Path) -> None:
    """Raise ConfigurationError unless a file is a store of Optuna's, empty or not there."""
    if not path.exists():
        return
    try:
        with closing(sqlite3.connect(path)) as file:
            tables = {name for (name,) in file.execute("select name from sqlite_master where type = 'table'")}
    except sqlite3.Error:
        tables = {"none of SQLite's"}
    if tables and not {"studies", "trials"} <= tables:
        raise ConfigurationError(refusal(STORE, str(path), "a file of Optuna's own, or a new one"))


def distribution(scale: Scale) -> BaseDistribution:
    """A scale in Optuna's words."""
    if scale.choices:
        return CategoricalDistribution(scale.choices)
    if scale.whole:
        return IntDistribution(int(scale.low), int(scale.high), log=scale.log)
    return FloatDistribution(float(scale.low), float(scale.high), log=scale.log)


def count_done(study: Study) -> int:
    """How many trials say something about their settings."""
    return len(study.get_trials(deepcopy=False, states=DONE))


def take_up(study: Study) -> int:
    """Put what failed or was interrupted first in line, once each; returns how many that are."""
    trials = study.get_trials(deepcopy=False)
    repeated = {trial.user_attrs.get(AGAIN) for trial in trials}
    for trial in trials:
        if trial.state == TrialState.RUNNING:
            study.tell(trial.number, state=TrialState.FAIL)
        if trial.state in (TrialState.RUNNING, TrialState.FAIL) and trial.params and trial.number not in repeated:
            study.enqueue_trial(trial.params, user_attrs={AGAIN: trial.number})
    return len(study.get_trials(deepcopy=False, states=[TrialState.WAITING]))


def ask(study: Study, space: Mapping[str, Scale], seed: int) -> Trial:
    """The next trial. What it is follows from the seed and what was tried before, also in a search that was stopped."""
    drawn = [trial for trial in study.get_trials(deepcopy=False) if AGAIN not in trial.user_attrs and trial.params]
    study.sampler = optuna.samplers.TPESampler(seed=seed + len(drawn))
    return study.ask({key: distribution(scale) for key, scale in space.items()})


def note_value(study: Study, trial: Trial, value: float | None) -> None:
    """How a trial ended: with a number, with nan for settings that have none, or with None where it failed."""
    if value is None:
        study.tell(trial, state=TrialState.FAIL)
    elif math.isfinite(value):
        study.tell(trial, value)
    else:
        study.tell(trial, state=TrialState.PRUNED)


def overrides_of(trial: Trial | FrozenTrial, space: Mapping[str, Scale]) -> list[str]:
    """A trial as overrides of a job."""
    return [f"{key}={scale.written(trial.params[key])}" for key, scale in space.items() if key in trial.params]


def best_trial(study: Study) -> FrozenTrial | None:
    """The trial with the best number; None where none has one."""
    return study.best_trial if study.get_trials(deepcopy=False, states=[TrialState.COMPLETE]) else None
