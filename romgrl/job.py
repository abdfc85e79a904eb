"""One job: each stage in its artifact directory, made once and reused wherever its key is the same."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from filelock import FileLock, Timeout
from rich.progress import Progress

from romgrl.artifacts import Manifest, open_artifact, write_manifest
from romgrl.config import Config
from romgrl.errors import RomgrlError
from romgrl.keys import STAGES, stage_config, stage_settings
from romgrl.progress import TerminalLog, format_duration
from romgrl.provenance import git_state, versions
from romgrl.recorder import RecordedRun, Recorder
from romgrl.worker import Runner

LOCK_SECONDS = 0.5  # between two looks at whether to stop waiting for another process


@dataclass
class Job:
    """One configuration on its way through the stages; threads may make stages that do not need each other."""

    config: Config
    recorder: Recorder
    run: RecordedRun
    bars: Progress
    keys: Mapping[str, str]
    finished: dict[str, Path] = field(default_factory=dict)
    stopping: threading.Event = field(default_factory=threading.Event)

    def directory(self, stage: str) -> Path:
        """Where the finished artifact of a stage is."""
        return Path(self.config.paths.outputs) / "artifacts" / stage / self.keys[stage]

    def say(self, *lines: str) -> None:
        """Print lines as they are, with none of another stage between them."""
        self.bars.console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)

    def ensure(self, stage: str, *, runner: Runner, threads: int) -> None:
        """Verify the artifact of a stage, or make it where there is none; what it needs must be finished."""
        directory = self.directory(stage)
        with self.exclusive(directory):
            reused = directory.exists()
            manifest = open_artifact(directory, stage=stage) if reused else self.make(stage, runner, threads)
        self.finished[stage] = directory
        if reused:
            self.say(f"{stage}: reused; it took {format_duration(manifest.wall_time)}")
            self.run.tags({f"romgrl.reused_from.{stage}": manifest.run_id or "untracked"})
            self.run.metrics({f"time_saved/{stage}": manifest.wall_time}, 0)
        self.run.tags({f"romgrl.key.{stage}": self.keys[stage], f"romgrl.run.{stage}": manifest.run_id or "untracked"})
        self.say(f"artifact: {directory}", f"mlflow run: {manifest.run_id or 'none'}")

    @contextmanager
    def exclusive(self, directory: Path) -> Iterator[None]:
        """Let one process at a time make an artifact; the others wait and then find it."""
        directory.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(directory.with_name(f".{directory.name}.lock"))
        try:
            lock.acquire(timeout=0)
        except Timeout:
            self.say(f"{directory.parent.name}: another process is making {directory.name}; waiting for it")
            self.wait_for(lock)
        try:
            yield
        finally:
            lock.release()

    def wait_for(self, lock: FileLock) -> None:
        """Acquire a lock, or raise KeyboardInterrupt once the job is being stopped."""
        while not lock.is_locked:
            if self.stopping.is_set():
                raise KeyboardInterrupt
            try:
                lock.acquire(timeout=LOCK_SECONDS)
            except Timeout:
                continue

    def make(self, stage: str, runner: Runner, threads: int) -> Manifest:
        """Run a stage in `<key>.partial`, describe what it wrote, and rename the whole to `<key>`."""
        directory = self.directory(stage)
        config = replace(stage_config(stage, self.config), threads=threads)
        inputs = {upstream: self.finished[upstream] for upstream in STAGES[stage].upstream}
        digests = {upstream: open_artifact(path, stage=upstream).digest for upstream, path in inputs.items()}
        settings = stage_settings(stage, self.config)
        partial = directory.with_name(f"{directory.name}.partial")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        upstream_keys = " ".join(f"{name}={self.keys[name]}" for name in inputs)
        tags = {"stage": stage, "key": self.keys[stage], "upstream": upstream_keys, "threads": str(threads)}
        run = self.recorder.start(stage, parent=self.run, tags=tags, params=settings)
        self.say(f"{stage}: started, {threads} thread{'s' if threads > 1 else ''}")
        start, status = time.monotonic(), "FAILED"
        try:
            with TerminalLog(stage, partial, sink=run.metrics, bars=self.bars) as log:
                runner(STAGES[stage].function, config, inputs, partial, log)
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
                threads=threads,
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
