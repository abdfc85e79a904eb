"""One job: each stage in its artifact directory, made once and reused wherever its key is the same."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.progress import Progress

from romgrl.artifacts import (
    Manifest,
    may_write,
    open_artifact,
    publish,
    read_manifest,
    require_right,
    setting_aside,
    storage_faults,
    write_manifest,
)
from romgrl.artifacts.locks import exclusive, lock_path, waited_for
from romgrl.artifacts.workspace import Workspace
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, RomgrlError
from romgrl.pipeline.run_names import stage_note, stage_title
from romgrl.pipeline.worker import Runner, working_lock
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import (
    require_same_body,
    require_same_libraries,
    stage_config,
    stage_function,
    stage_key,
    stage_settings,
)
from romgrl.provenance.versions import git_state, versions
from romgrl.report.terminal_tables import headline
from romgrl.runtime.stage_log import TerminalLog, format_duration
from romgrl.tracking.download import fetch_artifact
from romgrl.tracking.recorder import RecordedRun, Recorder


def health_tags(directory: Path) -> dict[str, str]:
    """What a training found wrong with its discriminator, as a tag of its run; none where it has none."""
    path = directory / "health.json"
    if not path.exists():
        return {}
    return {"romgrl.discriminator_health": json.loads(path.read_text(encoding="utf-8"))["verdict"]}


@dataclass
class Job:
    """One configuration on its way through the stages; threads may make stages that do not need each other."""

    config: Config
    recorder: Recorder
    run: RecordedRun
    bars: Progress
    overrides: Sequence[str] = ()
    directories: dict[str, Path] = field(default_factory=dict)
    finished: dict[str, Path] = field(default_factory=dict)
    manifests: dict[str, Manifest] = field(default_factory=dict)
    reused: dict[str, Manifest] = field(default_factory=dict)
    stopping: threading.Event = field(default_factory=threading.Event)

    def reads(self, stage: str) -> tuple[str, ...]:
        """The stages that a stage reads."""
        return STAGES[stage].reads(conditioned=is_conditioned(self.config))

    def directory(self, stage: str) -> Path | None:
        """Where the artifact of a stage is or will be; None while one that it reads is not there."""
        if stage not in self.directories:
            digests = {name: self.digest(name) for name in self.reads(stage)}
            known = {name: digest for name, digest in digests.items() if digest is not None}
            if len(known) < len(digests):
                return None
            key = stage_key(stage, self.config, known)
            self.directories[stage] = Path(self.config.paths.outputs) / "artifacts" / stage / key
        return self.directories[stage]

    def digest(self, stage: str) -> str | None:
        """Digest of the artifact of a stage, as its manifest says; None where there is none."""
        directory = self.directory(stage)
        if directory is None or not directory.exists():
            return None
        with setting_aside(directory):
            return read_manifest(directory).digest

    def present(self, stage: str) -> bool:
        """Tell whether the artifact of a stage is there."""
        directory = self.directory(stage)
        return directory is not None and directory.exists()

    def say(self, *lines: str) -> None:
        """Print lines as they are, with none of another stage between them."""
        self.bars.console.print("\n".join(lines), markup=False, highlight=False, soft_wrap=True)

    def ensure(self, stage: str, *, runner: Runner, threads: int) -> None:
        """Verify the artifact of a stage, or make it where there is none; what it needs must be finished."""
        directory = self.directory(stage)
        assert directory is not None
        with storage_faults(directory):
            manifest = self.whole(stage, directory)
            reused = manifest is not None
            if manifest is None:
                self.require_place(stage)
                with exclusive(directory, say=self.say, stopping=self.stopping.is_set):
                    reused = directory.exists() or self.fetched(stage, directory)
                    manifest = self.verify(stage, directory) if reused else self.make(stage, directory, runner, threads)
        self.finished[stage], self.manifests[stage] = directory, manifest
        if reused:
            Workspace(directory).close()  # whoever made it may not have come to that
            self.say(f"{stage}: reused; it took {format_duration(manifest.wall_time)}")
            self.reused[stage] = manifest
        self.run.tags({f"romgrl.key.{stage}": directory.name, f"romgrl.run.{stage}": manifest.run_id or "untracked"})
        self.say(f"artifact: {directory}", f"mlflow run: {manifest.run_id or 'none'}")
        if self.config.stage in STAGES:
            STAGES[self.config.stage].foresee(stage, self.config, directory)

    def fetched(self, stage: str, directory: Path) -> bool:
        """Take the artifact of a stage from the tracking server, where that is allowed and it has one."""
        return STAGES[stage].fetched and fetch_artifact(self.recorder, directory, self.say)

    def require_places(self, stages: Sequence[str]) -> None:
        """Raise ConfigurationError where this user may not write what is to be made, or what is to be set aside."""
        missing = [stage for stage in stages if not self.present(stage)]
        for stage in missing:
            self.require_place(stage)
        for stage in stages if missing else ():
            directory = self.directory(stage)
            if stage not in missing and directory is not None and not may_write(directory.parent):
                self.verify(stage, directory)

    def require_place(self, stage: str) -> None:
        """Raise ConfigurationError unless this user may make the artifact of a stage where it belongs."""
        directory, home = self.directory(stage), Path(self.config.paths.outputs) / "artifacts" / stage
        if os.path.lexists(home) and not home.is_dir():
            raise ArtifactError(f"{home}: is no directory; remove it, and the same command makes the {stage}")
        require_right(home, f"{stage} is to be made")
        if directory is not None:
            workspace = Workspace(directory)
            for place in (directory, workspace.partial):
                if os.path.lexists(place) and not place.is_dir():
                    raise ArtifactError(f"{place}: is no directory; remove it, and the same command makes the {stage}")
            for place in (lock_path(directory), lock_path(workspace.partial), *workspace.places):
                require_right(place, f"{stage} is to be made")

    def whole(self, stage: str, directory: Path) -> Manifest | None:
        """The manifest of a finished artifact that is whole, which takes no lock and no right to write.

        None where there is work for whoever holds the lock: it has to be made, or to be set aside. Raises
        ConfigurationError where it is damaged and this user may not set it aside.
        """
        if not directory.exists():
            return None
        if not may_write(directory.parent):
            return self.verify(stage, directory)
        with suppress(ArtifactError, FileNotFoundError):  # another process may set it aside at this moment
            return open_artifact(directory, stage=stage, key=directory.name)
        return None

    def verify(self, stage: str, directory: Path) -> Manifest:
        """The manifest of an artifact that is whole; a damaged one is set aside and ends the job."""
        with setting_aside(directory):
            return open_artifact(directory, stage=stage, key=directory.name)

    def numbers(self) -> dict[str, float]:
        """The numbers of all stages that are finished."""
        return {
            name: number
            for stage, directory in self.finished.items()
            for name, number in STAGES[stage].numbers(directory).items()
        }

    def record_reuse(self) -> None:
        """Tell MLflow which runs this job took its artifacts from, and the seconds that this saved."""
        if self.reused:
            sources = {stage: manifest.run_id or "untracked" for stage, manifest in sorted(self.reused.items())}
            times = {f"time_saved/{stage}": manifest.wall_time for stage, manifest in self.reused.items()}
            tags = {f"romgrl.reused_from.{stage}": run_id for stage, run_id in sources.items()}
            self.run.tags(tags | {"romgrl.reused_from": " ".join(f"{stage}={run}" for stage, run in sources.items())})
            self.run.metrics(times | {"time_saved": sum(times.values())}, 0)

    def make(self, stage: str, directory: Path, runner: Runner, threads: int) -> Manifest:
        """Run a stage in its workspace, describe what it wrote, and publish the whole."""
        config = replace(stage_config(stage, self.config), threads=threads)
        inputs = {upstream: self.finished[upstream] for upstream in self.reads(stage)}
        upstream = {name: self.verify(name, path) for name, path in inputs.items()}
        settings = stage_settings(stage, self.config)
        workspace = Workspace(directory)
        with waited_for(working_lock(workspace.partial), self.stopping.is_set):
            goes_on = workspace.open()
        run = self.start_run(stage, directory.name, upstream, settings, threads, workspace.run_id)
        workspace.note(run.local_id, workspace.seconds)
        self.say(f"{stage}: {'goes on' if goes_on else 'started'}, {threads} thread{'s' if threads > 1 else ''}")
        start, status = time.monotonic(), "FAILED"
        try:
            log = TerminalLog(stage, workspace.partial, sink=run.metrics, bars=self.bars)
            with storage_faults(workspace.partial), log:
                runner(stage_function(stage, self.config), config, inputs, workspace.partial, log)
            wall_time = workspace.seconds + time.monotonic() - start
            workspace.clear_checkpoint()
            require_same_body(self.config)
            require_same_libraries(self.config, settings)
            revision, dirty = git_state()
            manifest = write_manifest(
                workspace.partial,
                stage=stage,
                key=directory.name,
                config=settings,
                inputs={name: each.digest for name, each in upstream.items()},
                versions=versions(),
                revision=revision,
                dirty=dirty,
                seed=config.seed,
                wall_time=wall_time,
                run_id=run.run_id,
                threads=threads,
            )
            publish(workspace.partial, directory)
            run.tags(health_tags(directory))
            run.metrics(headline(STAGES[stage].numbers(directory)), 0)
            run.artifacts(directory)
            workspace.close()
            status = "FINISHED"
        except (KeyboardInterrupt, RomgrlError) as error:
            status = "KILLED" if isinstance(error, KeyboardInterrupt) else "FAILED"
            ended = "interrupted" if isinstance(error, KeyboardInterrupt) else "failed"
            seconds = time.monotonic() - start
            workspace.note(run.local_id, workspace.seconds + seconds)
            self.say(f"{stage}: {ended} after {format_duration(seconds)}; kept {workspace.partial}")
            raise
        finally:
            run.finish(status)
        self.say(f"{stage}: done in {format_duration(wall_time)}")
        return manifest

    def start_run(
        self,
        stage: str,
        key: str,
        upstream: Mapping[str, Manifest],
        settings: Mapping[str, object],
        threads: int,
        run_id: str | None,
    ) -> RecordedRun:
        """The MLflow run of a stage; that of an earlier attempt goes on."""
        read = " ".join(f"{name}={each.key}" for name, each in upstream.items())
        tags = {"stage": stage, "key": key, "upstream": read, "threads": str(threads)}
        title = stage_title(stage, self.config, self.overrides)
        run = self.recorder.start(title, parent=self.run, tags=tags, params=settings, run_id=run_id)
        run.describe(stage_note(title, stage, key, upstream))
        return run
