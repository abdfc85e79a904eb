"""A job, in this process or where a launcher of Hydra put it: its share of the machine, its end, its voice."""

from __future__ import annotations

import io
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TextIO

from rich.console import Console

from romgrl.cli.command import objective_after
from romgrl.config.schema import Config
from romgrl.errors import LaunchError, RomgrlError
from romgrl.pipeline import run as pipeline
from romgrl.report.objective import objective_of
from romgrl.results.sweep_record import JobEnd, note_end, position
from romgrl.runtime import signals
from romgrl.runtime.cores import available_cores
from romgrl.runtime.display import protect
from romgrl.runtime.stage_log import WIDEST_TABLE

PARENT_VARIABLE = "ROMGRL_PARENT_RUN"
LAUNCH_VARIABLE = "ROMGRL_LAUNCH"
FAILURES_FILE = "failures.jsonl"
STOPPING = "stopping"
RUNNING_SUFFIX = ".running"  # suffix of a file that is named by the process of a job
PARENT_SECONDS = 1.0  # between two looks at whether the sweep is still there
SHARES_TERMINAL = "joblib"  # the launcher whose jobs write to the terminal of the sweep and are stopped with it


@dataclass(frozen=True)
class Launch:
    """What the jobs of a sweep learn from its environment: how many share a machine, and in which keys they differ."""

    launcher: str
    directory: str
    at_once: int
    varied: list[str]

    def label(self, overrides: Sequence[str]) -> str:
        """The overrides of a job that the other jobs do not have."""
        return " ".join([text for text in overrides if text.partition("=")[0] in self.varied] or overrides) or "job"

    def announce(self) -> None:
        """Tell all processes that are started from now on."""
        os.environ[LAUNCH_VARIABLE] = json.dumps(asdict(self))

    def failures(self) -> list[tuple[str, int]]:
        """One line and one exit code for each job that failed."""
        path = Path(self.directory, FAILURES_FILE)
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        documents = [json.loads(line) for line in lines]
        return [(document["text"], document["exit_code"]) for document in documents]

    def leave(self, text: str, exit_code: int) -> None:
        """Let the sweep know that a job failed."""
        if self.launcher == SHARES_TERMINAL:
            sys.stderr.write(f"{text}\n")  # at once: a line and its end apart are mixed with those of other jobs
            sys.stderr.flush()
        with Path(self.directory, FAILURES_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"text": text, "exit_code": exit_code}) + "\n")

    def stop(self) -> None:
        """Interrupt the jobs that run here; those that wait for their turn do not start any more."""
        Path(self.directory, STOPPING).touch()
        for path in Path(self.directory).glob(f"*{RUNNING_SUFFIX}"):
            with suppress(ProcessLookupError):
                os.kill(int(path.stem), signal.SIGTERM)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let `stop` reach this process while the block runs; what the terminal sends comes to the sweep, too."""
        path, sweep, ended = Path(self.directory, f"{os.getpid()}{RUNNING_SUFFIX}"), os.getppid(), threading.Event()
        threading.Thread(target=end_with, args=(sweep, ended), daemon=True).start()
        for number in (signal.SIGINT, signal.SIGHUP):
            signals.leave(number)
            signal.signal(number, signal.SIG_IGN)
        signals.listen()
        try:
            path.touch()
            if Path(self.directory, STOPPING).exists():
                raise signals.Interrupted(signal.SIGTERM)
            yield
        finally:
            signals.rest()
            ended.set()
            path.unlink(missing_ok=True)
            if os.getppid() != sweep:
                os._exit(128 + signal.SIGTERM)  # nobody is left who would give this process another job


def end_with(sweep: int, ended: threading.Event) -> None:
    """Interrupt this process once that of its sweep is gone, killed by something that it cannot pass on."""
    while not ended.wait(PARENT_SECONDS):
        if os.getppid() != sweep:
            os.kill(os.getpid(), signal.SIGTERM)
            return


def announced() -> Launch | None:
    """What a sweep announced; None for jobs that run in its own process."""
    text = os.environ.get(LAUNCH_VARIABLE)
    return Launch(**json.loads(text)) if text else None


class Labelled(io.StringIO):
    """A stream that puts a label before each line, so that jobs can share a terminal."""

    encoding = "utf-8"
    """That of the stream, which rich draws by; of the class, so that it can be set."""

    def __init__(self, stream: TextIO, label: str) -> None:
        super().__init__()
        self._stream, self._label, self.encoding = stream, label, stream.encoding

    def write(self, text: str) -> int:
        """Write whole lines at once."""
        self._stream.write("".join(f"[{self._label}] {line}\n" for line in text.splitlines()))
        return len(text)

    def flush(self) -> None:
        """Show what was written."""
        self._stream.flush()


def run_job(config: Config, overrides: Sequence[str]) -> float | None:
    """Run a job, named by its overrides; returns the number that a search is after, nan for settings that have none.

    Raises RomgrlError; where a launcher put it, that is left with the sweep.
    """
    protect()  # a launcher's process has come here without `main`
    own = [text for text in overrides if not text.lstrip("+").startswith("hydra")]
    launch, parent, place = announced(), os.environ.get(PARENT_VARIABLE), position(own)
    if launch is None:
        made = run_noted(own, lambda: pipeline.run(config, overrides=own, parent=parent, place=place))
        return objective_of(config.objective, made)
    label = launch.label(own)
    console = Console(file=Labelled(sys.stdout, label), width=WIDEST_TABLE, force_terminal=False)
    shared = replace(config, threads=config.threads or max(1, available_cores() // launch.at_once))
    run = partial(pipeline.run, shared, overrides=own, parent=parent, place=place, console=console)
    try:
        return objective_of(config.objective, run_launched(launch, lambda: run_noted(own, run)))
    except RomgrlError as error:
        launch.leave(f"[{label}] {error}", error.exit_code)
        return objective_after(error)
    except signals.Interrupted as error:
        launch.leave(f"[{label}] {error}", error.exit_code)
        return None


def run_noted(overrides: list[str], run: Callable[[], dict[str, Path]]) -> dict[str, Path]:
    """Run a job and write down for its sweep how it ended; what it raised goes on. Returns the artifacts."""
    start = time.monotonic()
    try:
        made = run()
    except (RomgrlError, KeyboardInterrupt) as error:
        why = str(error) if isinstance(error, RomgrlError) else "interrupted"
        note_end(JobEnd(overrides, error=why, seconds=time.monotonic() - start))
        raise
    artifacts = {stage: str(path) for stage, path in made.items()}
    note_end(JobEnd(overrides, artifacts, seconds=time.monotonic() - start))
    return made


def run_launched(launch: Launch, run: Callable[[], dict[str, Path]]) -> dict[str, Path]:
    """Run a job; one that its launcher interrupts is handed over to it, with all saved, to be started again."""
    if launch.launcher == SHARES_TERMINAL:
        with launch.running():
            return run()
    signals.leave(signal.SIGTERM)  # submitit's to ignore: Slurm sends it together with the signal to requeue
    try:
        return run()
    except signals.Interrupted as interrupted:
        try:
            signals.hand_over(interrupted)
        except RuntimeError as error:  # submitit does not start it again
            raise LaunchError(str(error)) from error
        raise
