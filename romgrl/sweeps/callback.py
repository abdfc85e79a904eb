"""Hydra callback of sweeps: where their jobs run, and the parent run that they share. All of them were checked."""

from __future__ import annotations

import atexit
import os
import shlex
import signal
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from tempfile import mkdtemp
from types import FrameType
from typing import Any

from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from romgrl.artifacts import may_write, require_right, storage_faults
from romgrl.cli.hydra_internals import use_sweeper
from romgrl.cli.hydra_loader import stored_sweep, sweep_jobs
from romgrl.cli.hydra_settings import searches
from romgrl.errors import ConfigurationError, LaunchError, RomgrlError, StorageError
from romgrl.provenance.stage_graph import ACTIONS
from romgrl.provenance.versions import machine
from romgrl.results.sweep_record import SWEEP_VARIABLE, UNFINISHED, read_sweep, settings, write_sweep
from romgrl.runtime.cores import available_cores
from romgrl.runtime.signals import SIGNALS
from romgrl.sweeps.launch import LAUNCH_VARIABLE, PARENT_VARIABLE, SHARES_TERMINAL, Launch
from romgrl.sweeps.search import OptunaSweeper, searching
from romgrl.sweeps.sweep_directory import claim
from romgrl.tracking.journal import redacted
from romgrl.tracking.recorder import open_recorder

BUDGET_GROUPS = ("teacher", "student")
BUDGETS = ("teacher.total_steps", "teacher.generations", "student.total_steps")  # a teacher has one of the two


def check_launcher(config: DictConfig) -> None:
    """Raise ConfigurationError where the launcher, or what it needs, is not installed."""
    target = str(config.hydra.launcher._target_)
    name = config.hydra.runtime.choices["hydra/launcher"]
    try:
        installed = find_spec(target.rpartition(".")[0]) is not None
    except ModuleNotFoundError:
        installed = False
    if not installed:
        library = f"hydra-{str(name).partition('_')[0]}-launcher"
        raise ConfigurationError(f"hydra/launcher={name}: is not installed; pip install {library}")
    if name == "submitit_slurm" and not (which("sbatch") and which("srun")):
        raise ConfigurationError(f"hydra/launcher={name}: there is no sbatch and srun of Slurm on this machine")


def plan_launch(config: DictConfig, jobs: int) -> Launch | None:
    """How a launcher spreads the jobs; None where they run in this process, as with joblib and one process."""
    name = str(config.hydra.runtime.choices["hydra/launcher"])
    processes = joblib_processes(config.hydra.launcher.get("n_jobs", 1)) if name == "joblib" else 0
    if name == "basic" or processes == 1:
        return None
    at_once = {"joblib": processes, "submitit_local": jobs}.get(name, 1)
    parsed = OverridesParser.create().parse_overrides([*stored_sweep(config), *config.hydra.overrides.task])
    varied = [override.get_key_element() for override in parsed if override.is_sweep_override()]
    most = int(config.hydra.sweeper.n_jobs) if searches(config) else jobs
    return Launch(name, str(config.hydra.sweep.dir), max(1, min(at_once, jobs, most)), varied)


def joblib_processes(n_jobs: int) -> int:
    """What joblib makes of n_jobs: -1 is all cores, -2 all but one."""
    return n_jobs if n_jobs > 0 else available_cores() + 1 + n_jobs


def note_sweep(directory: Path, name: str, jobs: list[list[str]], loader: ConfigLoader) -> None:
    """Write down what a sweep was asked for, where it runs, and the usual budgets of its teacher and student."""
    named = loader.load_configuration(name, [], RunMode.RUN).hydra.runtime.choices
    usual = loader.load_configuration("config", [f"{group}={named[group]}" for group in BUDGET_GROUPS], RunMode.RUN)
    write_sweep(
        directory,
        name,
        redacted(shlex.join(["python", "-m", "romgrl", *sys.argv[1:]])),
        [[redacted(text) for text in job] for job in jobs],
        machine=machine() | {"cores_used": available_cores()},
        started=time.time(),
        usual={key: steps for key in BUDGETS if (steps := OmegaConf.select(usual, key)) is not None},
    )


class SweepCallback(Callback):
    """Opens the parent run at the start of `-m` and closes it at the end; jobs find its id in the environment."""

    def __getstate__(self) -> dict[str, Any]:
        """Launchers send the callbacks to other processes, where this one has nothing to do."""
        return {}

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Start the parent run."""
        check_launcher(config)
        if searches(config):
            with searching(config, GlobalHydra.instance().config_loader()):
                use_sweeper(OptunaSweeper)
        trains = self._trains = config.stage not in ACTIONS
        place = Path(str(config.hydra.sweep.dir)).absolute()
        if trains or may_write(place):
            require_right(place, "the tables of the sweep are to be made", key="hydra.sweep.dir")
        else:
            config.hydra.sweep.dir = mkdtemp(prefix="romgrl-")  # for Hydra, which writes what it was asked for
        self._directory, self._lock = claim(config)
        tracking = config.tracking
        outputs = Path(str(config.paths.outputs)).resolve()
        tracked = tracking.enabled and trains
        self._recorder = open_recorder(tracking.uri, str(tracking.experiment), outputs, enabled=tracked)
        overrides = [*config.hydra.overrides.task]
        stored = str(config.hydra.job.config_name)
        chosen = [text for text in overrides if settings([text])]
        name = " ".join(["sweep", *([stored] if stored != "config" or not chosen else []), *chosen])
        loader = GlobalHydra.instance().config_loader()
        planned = [] if searches(config) else sweep_jobs([*stored_sweep(config), *overrides], loader)
        jobs = int(config.hydra.sweeper.n_trials) if searches(config) else len(planned)
        self._run = self._recorder.start(name, tags={"stage": "sweep"}, params={"jobs": jobs})
        self._outputs = outputs
        if trains:
            with storage_faults(self._directory):
                note_sweep(self._directory, str(config.hydra.job.config_name), planned, loader)
        atexit.register(self._end, "KILLED")
        os.environ[PARENT_VARIABLE] = self._run.local_id if tracked else ""
        self._launch, self._signals = plan_launch(config, jobs), Signals()
        if self._launch is not None:
            self._announce(self._launch, jobs)

    def _announce(self, launch: Launch, jobs: int) -> None:
        launch.announce()
        if launch.launcher == SHARES_TERMINAL:
            self._signals.pass_on(launch.stop)
            print(f"sweep: {jobs} jobs, {launch.at_once} at once", flush=True)
        else:
            print(f"sweep: {jobs} jobs; what they say is in {launch.directory}/.submitit", flush=True)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Close the parent run; the exit code of jobs in other processes is that of the first one that failed."""
        failures = self._launch.failures() if self._launch is not None else []
        codes = [code for _, code in failures]
        if self._launch is not None and self._launch.launcher != SHARES_TERMINAL:
            print("".join(f"{text}\n" for text, _ in failures), end="", file=sys.stderr)
        os.environ.pop(SWEEP_VARIABLE, None)
        wanted = self._trains and self._signals.first is None
        status = "FAILED"
        try:
            unjoined = [*self._join(), *self._unended()] if wanted else []
            codes += unjoined
            status = "KILLED" if self._signals.first is not None else "FAILED" if unjoined else "FINISHED"
        except KeyboardInterrupt:
            status = "KILLED"
            raise
        finally:
            self._end(status)
            os.environ.pop(PARENT_VARIABLE, None)
            os.environ.pop(LAUNCH_VARIABLE, None)
        if self._signals.first is not None:
            sys.exit(128 + self._signals.first)
        if codes:
            sys.exit(codes[0])

    def _join(self) -> list[int]:
        """Tables and figures of all jobs, for the parent run; where they cannot be made, the exit code of that."""
        from romgrl.results.sweep_tables import TABLE_FILE, write_joint  # takes a second to import

        try:
            sweep = read_sweep(self._directory)
            if not sweep.jobs:  # of a search that was finished before
                return []
            directory = write_joint(sweep, self._outputs)
        except (RomgrlError, OSError) as error:
            print(f"sweep: no tables and figures: {error}", file=sys.stderr)
            return [getattr(error, "exit_code", StorageError.exit_code)]
        text = (directory / TABLE_FILE).read_text(encoding="utf-8")
        self._run.artifacts(directory)
        self._run.describe(text)
        print(text.partition("\n## ")[0])  # without the best jobs and the cost
        print(f"sweep: tables and figures of all jobs: {directory}", flush=True)
        return []

    def _unended(self) -> list[int]:
        """An exit code where jobs of the sweep left no word of how they ended."""
        sweep = read_sweep(self._directory)
        lost = [job for job in sweep.jobs if sweep.end_of(job).error == UNFINISHED]
        if lost:
            print(f"sweep: {len(lost)} of {len(sweep.jobs)} jobs did not end: {' '.join(lost[0])}", file=sys.stderr)
        return [LaunchError.exit_code] if lost else []

    def _end(self, status: str) -> None:
        atexit.unregister(self._end)
        self._run.finish(status)
        self._recorder.close()
        self._lock.release()


class Signals:
    """Signals to a sweep whose jobs are other processes: they end in good order, and the sweep after them."""

    def __init__(self) -> None:
        self.first: int | None = None

    def pass_on(self, stop: Callable[[], None]) -> None:
        """Answer all SIGNALS with `stop`."""

        def answer(number: int, frame: FrameType | None) -> None:
            self.first = self.first or number
            stop()

        for number in SIGNALS:
            signal.signal(number, answer)
