"""A search: Hydra's sweeper whose jobs Optuna chooses, a batch after what it learnt of the one before.

hydra-optuna-sweeper does this for others: its last release (1.3.0) needs Optuna 2, which cannot open a store with the
SQLAlchemy 2.1 that MLflow has here, and the next one (1.4) needs Hydra 1.4. Its keys have the same names here.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from filelock import FileLock, Timeout
from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, RunMode, TaskFunction
from omegaconf import DictConfig

from romgrl.artifacts import storage_faults
from romgrl.cli.compose import to_config
from romgrl.cli.hydra_loader import split_search, stored_sweep
from romgrl.cli.search_space import Scale
from romgrl.config.values import keys_of, refusal, value_of
from romgrl.errors import ConfigurationError
from romgrl.results.sweep_record import HOW, RESULTS, add_jobs
from romgrl.sweeps.launch import STOPPING
from romgrl.tracking.journal import redacted

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import Trial

TRIALS_FILE = "trials.csv"


def require_optuna() -> None:
    """Raise ConfigurationError where Optuna is not installed."""
    if find_spec("optuna") is None:
        raise ConfigurationError("hydra/sweeper=optuna: is not installed; pip install optuna, the extra romgrl[optuna]")


def common_settings(config: DictConfig, space: dict[str, Scale], fixed: Sequence[str], loader: Any) -> dict[str, Any]:
    """What all trials of a search have in common: the settings that it does not vary, and what it varies how."""
    some = [f"{key}={scale.probes[0]}" for key, scale in space.items()]
    common = to_config(loader.load_configuration(config.hydra.job.config_name, [*fixed, *some], RunMode.RUN))
    keys = [key for key in keys_of(common) if key.partition(".")[0] not in HOW or key in ("objective", "stage")]
    varied = {key: str(scale) for key, scale in space.items()}
    return {key: value_of(common, key) for key in keys if key not in space} | varied


@contextmanager
def searching(config: DictConfig, loader: Any) -> Iterator[tuple[Study, dict[str, Scale], list[str]]]:
    """The study of a search, what it varies and the overrides of all jobs; nobody else's while the block runs.

    Raises ConfigurationError where it cannot be had.
    """
    require_optuna()
    from romgrl.sweeps.study import NAME, open_study, store_faults

    sweeper = config.hydra.sweeper
    store, name = Path(str(sweeper.storage)), str(sweeper.study_name)
    space, fixed = split_search([*stored_sweep(config), *config.hydra.overrides.task], loader)
    settings = common_settings(config, space, fixed, loader)
    lock = FileLock(store.with_name(f".{store.name}.{quote(name, safe='')}.lock"))
    with storage_faults(store):
        store.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(blocking=False)
        except Timeout:
            raise ConfigurationError(refusal(NAME, name, "a name that no other search is using now")) from None
    try:
        study = open_study(store, name, sweeper.direction, settings)
        with store_faults(store):
            yield study, space, fixed
    finally:
        lock.release()


class OptunaSweeper(Sweeper):
    """`hydra/sweeper=optuna`; conf/hydra/sweeper/optuna.yaml has its keys."""

    def __init__(self, n_trials: int, n_jobs: int, seed: int, **keys: Any) -> None:
        self.n_trials, self.n_jobs, self.seed = int(n_trials), int(n_jobs), int(seed)
        self.search: DictConfig

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Called by Hydra."""
        self.search = config
        self.loader = hydra_context.config_loader
        self.launcher: Launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Try settings until n_trials of the study say something about theirs, but no more of them than are missing."""
        with searching(self.search, self.loader) as (study, space, fixed):
            from romgrl.sweeps import study as trials

            directory = Path(str(self.search.hydra.sweep.dir))
            known = trials.count_done(study)
            missing = max(0, self.n_trials - known)
            again = trials.take_up(study) if missing else 0
            print(f"search: {known} of {self.n_trials} trials are done, {again} to be tried again", flush=True)
            for start in range(0, missing, self.n_jobs):
                batch = [trials.ask(study, space, self.seed) for _ in range(min(self.n_jobs, missing - start))]
                if not self.launch(study, batch, space, fixed, start, missing):
                    break
            self.conclude(study, space, directory)

    def launch(
        self, study: Study, batch: list[Trial], space: dict[str, Scale], fixed: list[str], start: int, trials: int
    ) -> bool:
        """Run a batch and tell Optuna how it ended; false where a signal stopped it, which leaves the rest waiting."""
        from romgrl.sweeps.study import note_value, overrides_of

        directory = Path(str(self.search.hydra.sweep.dir))
        jobs = [[*fixed, *overrides_of(trial, space)] for trial in batch]
        add_jobs(directory, [[redacted(text) for text in job] for job in jobs], trials)
        returned = self.launcher.launch(jobs, initial_job_idx=start)
        stopped = (directory / STOPPING).exists()
        for trial, job in zip(batch, returned, strict=True):
            value = job.return_value  # raises what a job did not expect
            if value is not None or not stopped:
                note_value(study, trial, value)
        return not stopped

    def conclude(self, study: Study, space: dict[str, Scale], directory: Path) -> None:
        """Say which trial is the best, and write a row for each that was told."""
        from romgrl.sweeps.study import ENDED, best_trial, overrides_of

        told = study.get_trials(deepcopy=False, states=tuple(ENDED))
        rows = [
            {"trial": trial.number, "ended": ENDED[trial.state], "objective": trial.value}
            | dict(text.split("=", 1) for text in overrides_of(trial, space))
            for trial in told
        ]
        (directory / RESULTS).mkdir(parents=True, exist_ok=True)
        with (directory / RESULTS / TRIALS_FILE).open("w", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, ["trial", "ended", "objective", *space])
            table.writeheader()
            table.writerows(rows)
        name, best = self.search.objective, best_trial(study)
        if best is None:
            print(f"search: no trial has {name}", file=sys.stderr, flush=True)
        else:
            where = " ".join(overrides_of(best, space))
            print(f"search: best {name} = {best.value:.6g} of trial {best.number}: {where}", flush=True)
