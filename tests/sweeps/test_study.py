"""What Optuna is told of trials, what it tries next, and which stores and studies are refused."""

from __future__ import annotations

import math
import sqlite3
from contextlib import closing
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

from romgrl.cli.search_space import Scale
from romgrl.errors import ConfigurationError, StorageError
from romgrl.sweeps import study as trials

SPACE = {"eta": Scale((), 0.1, 0.9), "noise": Scale((), 0.01, 0.2, log=True), "window": Scale(("1", "2", "4"))}
FIXED = {"speed": 4.0, "student.hidden_sizes": [32, 32]}


def opened(directory: Path, name: str = "one") -> optuna.Study:
    """A study of this test."""
    return trials.open_study(directory / "optuna.db", name, "minimize", FIXED)


def value(trial: optuna.trial.Trial) -> float:
    """What a trial comes to: smallest in the middle."""
    return abs(trial.params["eta"] - 0.5) + abs(math.log(trial.params["noise"] / 0.05))


def searched(study: optuna.Study, number: int) -> list[list[str]]:
    """The overrides of the next trials, which are told."""
    found = []
    for _ in range(number):
        trial = trials.ask(study, SPACE, seed=3)
        found.append(trials.overrides_of(trial, SPACE))
        trials.note_value(study, trial, value(trial))
    return found


def test_a_search_that_was_stopped_tries_what_it_would_have_tried(tmp_path: Path) -> None:
    through = searched(opened(tmp_path, "through"), 12)  # the first ten are random
    study = opened(tmp_path)
    before = searched(study, 10)
    stopped = trials.overrides_of(trials.ask(study, SPACE, seed=3), SPACE)  # killed here
    study = opened(tmp_path)
    assert trials.take_up(study) == 1
    assert trials.take_up(study) == 1  # once
    after = searched(study, 2)
    assert after[0] == stopped
    assert before + after == through
    assert len({*map(tuple, through)}) == 12


def test_how_a_trial_ended_is_its_state(tmp_path: Path) -> None:
    study = opened(tmp_path)
    for number in (1.5, math.nan, math.inf, None, 0.5):
        trials.note_value(study, trials.ask(study, SPACE, seed=0), number)
    states = [trial.state for trial in study.get_trials()]
    assert states == [
        TrialState.COMPLETE,
        TrialState.PRUNED,
        TrialState.PRUNED,
        TrialState.FAIL,
        TrialState.COMPLETE,
    ]
    assert trials.count_done(study) == 4
    best = trials.best_trial(study)
    assert best is not None
    assert best.number == 4
    assert trials.take_up(study) == 1  # what failed
    again = trials.ask(study, SPACE, seed=0)
    assert again.params == study.get_trials()[3].params


def test_a_store_that_breaks_is_told_on_one_line(tmp_path: Path) -> None:
    study = opened(tmp_path)
    with closing(sqlite3.connect(tmp_path / "optuna.db")) as file:
        file.execute("drop table trial_params")
    told = pytest.raises(StorageError, match=r"^.*/optuna.db: .*no such table: trial_params")
    with told, trials.store_faults(tmp_path / "optuna.db"):
        trials.ask(study, SPACE, seed=0)


def test_numbers_are_short_and_inside(tmp_path: Path) -> None:
    assert Scale((), 0.12344, 0.9).written(0.123445) == "0.12344"
    assert Scale((), 0.1, 0.9).written(0.123456) == "0.1235"
    assert Scale((), 1, 8, whole=True).written(3) == "3"
    assert Scale(("a", "b")).written("b") == "b"


def test_a_study_has_one_meaning(tmp_path: Path) -> None:
    opened(tmp_path)
    opened(tmp_path)
    store = tmp_path / "optuna.db"
    with pytest.raises(ConfigurationError, match=r"^hydra.sweeper.study_name: one .* has speed = 4.0, not 3.0$"):
        trials.open_study(store, "one", "minimize", FIXED | {"speed": 3.0})
    with pytest.raises(ConfigurationError, match=r"has hydra.sweeper.direction = minimize, not maximize$"):
        trials.open_study(store, "one", "maximize", FIXED)
    trials.open_study(store, "another", "maximize", FIXED)


@pytest.mark.parametrize("content", ["mlflow", "text"])
def test_a_store_of_something_else_is_refused_and_left_alone(tmp_path: Path, content: str) -> None:
    store = tmp_path / "optuna.db"
    if content == "text":
        store.write_text("no database " * 99, encoding="utf-8")
    else:
        with closing(sqlite3.connect(store)) as file:
            file.execute("create table experiments (name text)")
            file.commit()
    before = store.read_bytes()
    with pytest.raises(ConfigurationError, match=r"^hydra.sweeper.storage: .*a file of Optuna's own, or a new one$"):
        opened(tmp_path)
    assert store.read_bytes() == before
