"""A disk that is full or read-only ends a job with one line; what was there before is whole, and the job goes on."""

from __future__ import annotations

import errno
import io
import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.artifacts import open_artifact
from romgrl.artifacts.checkpoint import CHECKPOINT, Checkpoints, Ring
from romgrl.config.schema import Config
from romgrl.errors import StorageError
from romgrl.pipeline import run as pipeline
from romgrl.pipeline import worker
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages.training.checkpoints import TrainingCheckpoints
from tests.conftest import Composer
from tests.faults.injection import Faults
from tests.helpers.cut_trainings import Recorder, files, train, training
from tests.helpers.jobs import Command

FAULTS = {"full": errno.ENOSPC, "read-only": errno.EROFS}


def one_line(error: StorageError, directory: Path, code: int) -> None:
    """It names a place in the directory and says what is wrong with the disk."""
    text = str(error)
    assert len(text.splitlines()) == 1
    assert text.startswith(str(directory))
    assert text.endswith(os.strerror(code))
    assert error.exit_code == 5


@pytest.mark.usefixtures("fakes")
def test_a_stage_on_a_bad_disk_leaves_what_was_there(smoke_config: Config, tmp_path: Path) -> None:
    """At its first write, in the middle, and when it is published."""
    survived = 0
    for name, code in FAULTS.items():
        for share in (0.0, 0.5, 0.9):
            outputs = tmp_path / f"{name}-{share}"
            config = replace(
                smoke_config,
                paths=replace(smoke_config.paths, outputs=str(outputs)),
                tracking=replace(smoke_config.tracking, enabled=False),
            )

            def run(stage: str, config: Config = config) -> dict[str, Path]:
                return pipeline.run(replace(config, stage=stage), console=Console(file=io.StringIO()))

            before = run("reference") | run("baseline")
            counted = Faults(lasting=True)
            with counted.installed():
                spare = replace(config, seed=1, stage="baseline")
                pipeline.run(spare, console=Console(file=io.StringIO()))
            with (
                Faults(int(share * counted.counted), code, lasting=True).installed(),
                pytest.raises(StorageError) as end,
            ):
                run("student")
            one_line(end.value, outputs, code)
            assert [
                path for path in outputs.glob("artifacts/student/*/manifest.json") if "." not in path.parent.name
            ] == []
            for stage, path in before.items():
                open_artifact(path, stage=stage, key=path.name)
            after = run("student")
            open_artifact(after["student"], stage="student")
            assert after["reference"] == before["reference"]
            survived += 1
    assert survived == 6
    print(f"{survived} of 6 stages on a bad disk ended in one line and left what was there")


@pytest.mark.parametrize(
    ("name", "share", "kind"),
    [
        ("teacher", 0.5, "full"),
        ("teacher", 0.8, "read-only"),
        pytest.param("student", 0.3, "read-only", marks=pytest.mark.slow),
        ("student", 0.8, "full"),
    ],
)
def test_a_training_on_a_bad_disk_keeps_its_checkpoint(
    name: str, share: float, kind: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a checkpoint after every pass; the training then goes on to the bits of one that nothing disturbed."""
    shorter = ["teacher.total_steps=2048", "student.total_steps=480", "checkpoint_seconds=1e-9"]
    config = training(name, compose_config, *shorter)
    recorder, rings = Recorder(monkeypatch), list[Ring | None]()
    saved = watch_saves(monkeypatch, rings)
    counted = Faults(lasting=True)
    with counted.installed():
        train(name, config, tmp_path / "whole")
    whole = (recorder.state, files(tmp_path / "whole"))
    recorder.again()
    saved.clear()
    output = tmp_path / "disturbed"
    code = FAULTS[kind]
    with Faults(int(share * counted.counted), code, lasting=True).installed(), pytest.raises(StorageError) as end:
        train(name, config, output)
    one_line(end.value, tmp_path, code)
    assert len(saved) >= 3
    found = Checkpoints(output / CHECKPOINT, ring=rings[-1], say=pytest.fail).load()
    assert found is not None
    assert found[0] in (saved[-1], recorder.steps[-1])
    recorder.again()
    train(name, config, output)
    assert recorder.steps[0] > found[0]
    assert (recorder.state, files(output)) == whole
    print(f"{name}, disk {kind} at step {recorder.steps[0]}: checkpoint of step {found[0]} whole; 1 of 1 went on")


def watch_saves(monkeypatch: pytest.MonkeyPatch, rings: list[Ring | None]) -> list[int]:
    """Steps of the checkpoints that were written to the end."""
    saved: list[int] = []
    save, start = Checkpoints.save, TrainingCheckpoints.__init__

    def watched(checkpoints: Checkpoints, step: int, state: dict[str, object]) -> None:
        save(checkpoints, step, state)
        saved.append(step)

    def started(checkpoints: TrainingCheckpoints, *arguments: object, **keywords: object) -> None:
        start(checkpoints, *arguments, **keywords)
        rings.append(keywords.get("ring"))

    monkeypatch.setattr(Checkpoints, "save", watched)
    monkeypatch.setattr(TrainingCheckpoints, "__init__", started)
    return saved


Mount = Callable[..., None]


@pytest.fixture
def mount(tmp_path: Path) -> Iterator[Mount]:
    """A file system of half a megabyte at outputs/artifacts, where the machine lets the test mount one."""
    place = tmp_path / "outputs" / "artifacts"
    place.mkdir(parents=True)

    def mounted(options: str) -> None:
        line = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
        if subprocess.run(line, capture_output=True, check=False).returncode != 0:
            pytest.skip("a file system may only be mounted by root")

    yield mounted
    subprocess.run(["umount", str(place)], capture_output=True, check=False)


def test_a_disk_that_is_really_full(mount: Mount, command: Command, tmp_path: Path) -> None:
    """A line on standard error, exit code 5, and the job succeeds once there is room."""
    mount("size=512k")
    arguments = ("experiment=smoke", "threads=1", "tracking=none")
    assert command(*arguments, "stage=teacher").returncode == 0
    ballast = tmp_path / "outputs" / "artifacts" / "ballast"
    for left in (0, 8192):
        fill(ballast)
        os.truncate(ballast, ballast.stat().st_size - left)
        result = command(*arguments, "stage=reference")
        assert (result.returncode, len(result.stderr.splitlines())) == (5, 1), result.stderr
        assert result.stderr.endswith("No space left on device\n")
    ballast.unlink()
    result = command(*arguments, "stage=reference")
    assert (result.returncode, "teacher: reused" in result.stdout) == (0, True), result.stderr


def fill(path: Path) -> None:
    """Take all the room that is left on a disk."""
    with path.open("ab", buffering=0) as file, suppress(OSError):
        while True:
            file.write(b"0" * 4096)


def test_a_disk_that_is_really_read_only(mount: Mount, command: Command) -> None:
    mount("size=512k,ro")
    result = command("experiment=smoke", "threads=1", "tracking=none", "stage=teacher")
    assert (result.returncode, len(result.stderr.splitlines())) == (5, 1), result.stderr
    assert result.stderr.endswith("Read-only file system\n")


def test_a_stage_that_writes_by_itself(smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables and pictures are written by libraries, which know only OSError; a worker must tell it in one line, too."""

    def stage(*_: object) -> None:
        Path("/dev/full").write_text("step,loss\n", encoding="utf-8")

    monkeypatch.setattr(worker, "load_function", lambda entry: stage)
    with pytest.raises(StorageError, match=r"^/.*: No space left on device$"):
        worker.execute("a:b", smoke_config, {}, tmp_path, SilentLog())
