"""Run one configuration: each stage in its artifact directory, made once and reused wherever its key is the same."""

from __future__ import annotations

import importlib
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock, Timeout
from rich.console import Console

from romgrl.artifacts import Manifest, open_artifact, write_manifest
from romgrl.config import Config
from romgrl.errors import RomgrlError
from romgrl.keys import STAGES, all_keys, stage_config, stage_settings
from romgrl.progress import StageLog, TerminalLog, format_duration
from romgrl.provenance import git_state, versions
from romgrl.summary import result_metrics, result_tables
from romgrl.validation import validate

if TYPE_CHECKING:
    from romgrl.tracking import TrackedRun, Tracker

StageFunction = Callable[[Config, Mapping[str, Path], Path, StageLog], None]


def run(
    config: Config, *, name: str = "job", parent: str | None = None, console: Console | None = None
) -> dict[str, Path]:
    """Run `config.stage` and what it needs, print where everything is, and return the artifact of each stage used.

    `parent` is the MLflow run of the sweep. Raises ConfigurationError before anything is made.
    """
    validate(config)
    config = resolve(config)
    listen_to_signals()
    from romgrl.tracking import Tracker, ui_command

    outputs = Path(config.paths.outputs)
    tracking = config.tracking
    tracker = Tracker(uri=tracking.uri, experiment=tracking.experiment, outputs=outputs, enabled=tracking.enabled)
    tracked = tracker.start(name, parent=parent, tags={"stage": "job"}, params=asdict(config))
    job = Job(config, tracker, tracked, console or Console(), all_keys(config))
    if parent is not None:
        job.say(f"job: {name}")
    status = "FAILED"
    try:
        for stage in STAGES if config.stage == "all" else (config.stage,):
            job.ensure(stage)
        if "evaluation" in job.finished:
            tracked.metrics(result_metrics(job.finished["evaluation"]), 0)
        status = "FINISHED"
    except KeyboardInterrupt:
        status = "KILLED"
        raise
    finally:
        tracked.finish(status)
    if "evaluation" in job.finished:
        for table in result_tables(job.finished["evaluation"]):
            job.console.print(table)
    if "report" in job.finished:
        job.say(f"figures and films: {job.finished['report']}")
    if tracked.run_id is not None:
        job.say(f"compare runs: {ui_command(tracker.uri)}")
    return job.finished


def listen_to_signals() -> None:
    """Let SIGINT and SIGTERM interrupt a stage in good order, also where a shell started the job in the background."""
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.default_int_handler)


def resolve(config: Config) -> Config:
    """Make the output directory absolute and the number of threads explicit."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    outputs = Path(config.paths.outputs).expanduser().resolve()
    return replace(config, threads=config.threads or cores, paths=replace(config.paths, outputs=str(outputs)))


def prepare(config: Config) -> None:
    """Seed torch and numpy and set torch's threads and rounding, the same before every stage."""
    import numpy as np
    import torch

    torch.manual_seed(config.seed)
    np.random.seed(config.seed)  # noqa: NPY002 - libraries may draw from the global generator
    torch.set_num_threads(config.threads)
    torch.set_flush_denormal(True)  # vanishing gradients cost up to 30 times the time


@dataclass
class Job:
    """One configuration on its way through the stages."""

    config: Config
    tracker: Tracker
    run: TrackedRun
    console: Console
    keys: dict[str, str]
    finished: dict[str, Path] = field(default_factory=dict)

    def directory(self, stage: str) -> Path:
        """Where the finished artifact of a stage is."""
        return Path(self.config.paths.outputs) / "artifacts" / stage / self.keys[stage]

    def say(self, text: str) -> None:
        """Print one line as it is."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def ensure(self, stage: str) -> Path:
        """Return the verified artifact of a stage; make it, and first what it needs, where there is none."""
        if stage in self.finished:
            return self.finished[stage]
        directory = self.directory(stage)
        if not directory.exists():
            for upstream in STAGES[stage].upstream:
                self.ensure(upstream)
        with self.exclusive(directory):
            reused = directory.exists()
            manifest = open_artifact(directory, stage=stage) if reused else self.make(stage, directory)
        self.finished[stage] = directory
        if reused:
            self.say(f"{stage}: reused; it took {format_duration(manifest.wall_time)}")
            self.run.tags({f"romgrl.reused_from.{stage}": manifest.run_id or "untracked"})
            self.run.metrics({f"time_saved/{stage}": manifest.wall_time}, 0)
        self.run.tags({f"romgrl.key.{stage}": self.keys[stage], f"romgrl.run.{stage}": manifest.run_id or "untracked"})
        self.say(f"artifact: {directory}")
        self.say(f"mlflow run: {manifest.run_id or 'none'}")
        return directory

    @contextmanager
    def exclusive(self, directory: Path) -> Iterator[None]:
        """Let one process at a time make an artifact; the others wait and then find it."""
        directory.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(directory.with_name(f".{directory.name}.lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            self.say(f"{directory.parent.name}: another process is making {directory.name}; waiting for it")
            lock.acquire()
        try:
            yield
        finally:
            lock.release()

    def make(self, stage: str, directory: Path) -> Manifest:
        """Run a stage in `<key>.partial`, describe what it wrote, and rename the whole to `<key>`."""
        config = stage_config(stage, self.config)
        inputs = {upstream: self.finished[upstream] for upstream in STAGES[stage].upstream}
        digests = {upstream: open_artifact(path, stage=upstream).digest for upstream, path in inputs.items()}
        settings = stage_settings(stage, self.config)
        partial = directory.with_name(f"{directory.name}.partial")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        upstream_keys = " ".join(f"{name}={self.keys[name]}" for name in inputs)
        tags = {"stage": stage, "key": self.keys[stage], "upstream": upstream_keys}
        run = self.tracker.start(stage, parent=self.run.run_id, tags=tags, params=settings)
        self.say(f"{stage}: started")
        prepare(config)
        start, status = time.monotonic(), "FAILED"
        try:
            with TerminalLog(stage, partial, sink=run.metrics, console=self.console) as log:
                load_function(STAGES[stage].function)(config, inputs, partial, log)
            wall_time = time.monotonic() - start
            revision, dirty = git_state()
            manifest = write_manifest(
                partial,
                stage=stage,
                key=self.keys[stage],
                config=settings,
                inputs=digests,
                versions=versions(),
                revision=revision,
                dirty=dirty,
                seed=config.seed,
                wall_time=wall_time,
                run_id=run.run_id,
            )
            run.artifacts(partial)
            os.replace(partial, directory)
            status = "FINISHED"
        except (KeyboardInterrupt, RomgrlError) as error:
            status = "KILLED" if isinstance(error, KeyboardInterrupt) else "FAILED"
            ended = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
            self.say(f"{stage}: {ended} after {format_duration(time.monotonic() - start)}; kept {partial}")
            raise
        finally:
            run.finish(status)
        self.say(f"{stage}: done in {format_duration(wall_time)}")
        return manifest


def load_function(entry: str) -> StageFunction:
    """Import `module:function`."""
    module, _, name = entry.partition(":")
    function: StageFunction = getattr(importlib.import_module(module), name)
    return function
