"""`stage=watch`: the student or baseline of a configuration as it is now, finished or in training."""

from __future__ import annotations

import tempfile
from pathlib import Path

from rich.console import Console

from romgrl.artifacts import may_write, open_artifact, read_manifest
from romgrl.artifacts.workspace import Workspace
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.pipeline.job import Job
from romgrl.pipeline.worker import execute
from romgrl.provenance.shipped import follows_shipped, is_pretrained, shipped, shipped_directory
from romgrl.runtime import signals
from romgrl.runtime.stage_log import TerminalLog, make_bars
from romgrl.tracking.recorder import Recorder

POLICY = "policy.safetensors"


def watch(config: Config, console: Console) -> dict[str, Path]:
    """Show the policy of `watch.walker`. Raises ArtifactError where there is none yet."""
    signals.listen()
    walker, outputs = config.watch.walker, Path(config.paths.outputs)
    recorder = Recorder("", "", outputs, enabled=False)
    bars = make_bars(console)
    job = Job(config, recorder, recorder.start("watch", tags={}), bars)
    directory = newest(job, walker)
    inputs = {walker: directory} | ({"library": library_of(job)} if is_conditioned(config) else {})
    name = directory.name if directory.is_relative_to(outputs) else read_manifest(directory).key
    output = film_directory(outputs / "watch" / name, walker)
    with TerminalLog("watch", output, bars=bars) as log:
        log.message(f"{walker} {'in training' if directory.suffix else 'as trained'}: {directory}")
        execute("romgrl.stages.watch:run", config, inputs, output, log)
    return {}


def film_directory(place: Path, walker: str) -> Path:
    """A directory for a film: beside the results or, for whoever may only read these, in one of its own."""
    if not may_write(place / f"{walker}.mp4"):
        return Path(tempfile.mkdtemp(prefix="romgrl-watch-"))
    place.mkdir(parents=True, exist_ok=True)
    return place


def library_of(job: Job) -> Path:
    """The finished library of a conditioned student that is there, and so is what taught it."""
    if is_pretrained("library", job.config):
        return shipped_directory("library", conditioned=True)
    directory = job.directory("library")
    assert directory is not None
    open_artifact(directory, stage="library", key=directory.name)
    return directory


def newest(job: Job, walker: str) -> Path:
    """The finished artifact of a walker, else the workspace of its training with the policy of its last checkpoint; the
    one of the package where it is pretrained."""
    if is_pretrained(walker, job.config):
        shipped(walker, conditioned=follows_shipped(job.config))
        return shipped_directory(walker, conditioned=follows_shipped(job.config))
    directory = job.directory(walker)
    if directory is not None and directory.exists():
        open_artifact(directory, stage=walker, key=directory.name)
        return directory
    partial = Workspace(directory).partial if directory is not None else None
    if partial is not None and (partial / POLICY).is_file():
        return partial
    place = Path(job.config.paths.outputs) / "artifacts" / walker
    raise ArtifactError(
        f"{place}: no {walker} of these settings, neither trained nor with a checkpoint; "
        f"python -m romgrl stage={walker} with the same settings trains it"
    )
