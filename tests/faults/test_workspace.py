"""A workspace survives the end of its process at every step between the first checkpoint and the published artifact."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from romgrl.artifacts import open_artifact, workspace
from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.config.schema import Config
from romgrl.errors import DivergenceError
from romgrl.pipeline import job
from romgrl.pipeline import run as pipeline
from romgrl.provenance import stage_graph
from romgrl.runtime.stage_log import StageLog


class Killed(BaseException):
    """Nothing after this runs, as after a kill -9."""


def counting(config: Config, inputs: dict[str, Path], output: Path, log: StageLog) -> None:
    """A stage of ten steps with a checkpoint after each; ends early where told to."""
    state = output / CHECKPOINT / "steps.txt"
    done = len(state.read_text(encoding="utf-8")) if state.exists() else 0
    for step in range(done, 10):
        with (output.parents[1] / "work.txt").open("a", encoding="utf-8") as work:
            work.write(f"{step} ")
        state.parent.mkdir(exist_ok=True)
        state.write_text("." * (step + 1), encoding="utf-8")
        if step == int(os.environ.get("STOP_AT", "-1")):
            raise DivergenceError("teacher: loss = nan at step 5")
    (output / "data.csv").write_text("done\n", encoding="utf-8")


@pytest.fixture
def teacher(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> Config:
    stage = stage_graph.STAGES["teacher"]
    fake = replace(stage, function="tests.faults.test_workspace:counting")
    monkeypatch.setitem(stage_graph.STAGES, "teacher", fake)
    return replace(smoke_config, stage="teacher", tracking=replace(smoke_config.tracking, enabled=False))


def run(config: Config) -> Path:
    return pipeline.run(config, console=Console(file=io.StringIO()))["teacher"]


def work(config: Config) -> list[int]:
    """Every step that was worked, in order."""
    return [
        int(step)
        for step in (Path(config.paths.outputs) / "artifacts" / "work.txt").read_text(encoding="utf-8").split()
    ]


def test_the_same_command_goes_on(teacher: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STOP_AT", "5")
    with pytest.raises(DivergenceError):
        run(teacher)
    monkeypatch.delenv("STOP_AT")
    made = run(teacher)
    assert work(teacher) == list(range(10))
    assert set(open_artifact(made).files) == {"curve.csv", "data.csv"} & {path.name for path in made.iterdir()}
    assert [path.name for path in made.parent.iterdir() if path.is_dir()] == [made.name]
    assert not list(made.parent.glob(".*.attempt"))


KILLS: dict[str, tuple[Any, str]] = {
    "before the checkpoint is put aside": (workspace.Workspace, "clear_checkpoint"),
    "before the manifest": (job, "write_manifest"),
    "before the rename": (os, "replace"),
    "after the rename": (workspace.Workspace, "close"),
}


@pytest.mark.parametrize("moment", KILLS)
def test_killed_while_publishing(teacher: Config, monkeypatch: pytest.MonkeyPatch, moment: str) -> None:
    """The finished work is not done again, and what is published is whole."""
    owner, name = KILLS[moment]
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, dying(getattr(owner, name), Path(teacher.paths.outputs)))
        with pytest.raises(Killed):
            run(teacher)
    made = run(teacher)
    assert work(teacher) == list(range(10))
    assert "data.csv" in open_artifact(made).files
    assert not (made / CHECKPOINT).exists()
    assert [path.name for path in made.parent.iterdir() if path.is_dir()] == [made.name]


def dying(original: Callable[..., Any], outputs: Path) -> Callable[..., Any]:
    """Die instead of doing it; a rename only where it would publish."""

    def replacement(*arguments: Any, **named: Any) -> Any:
        if original is os.replace and not str(arguments[0]).endswith(".partial"):
            return original(*arguments, **named)
        raise Killed

    return replacement


def test_what_has_no_checkpoint_begins_with_nothing(tmp_path: Path) -> None:
    place = workspace.Workspace(tmp_path / "key")
    assert not place.open()
    (place.partial / "half.npz").write_bytes(b"")
    assert not workspace.Workspace(tmp_path / "key").open()
    assert not list(place.partial.iterdir())


def test_a_lost_note_costs_no_training(tmp_path: Path) -> None:
    place = workspace.Workspace(tmp_path / "key")
    place.open()
    (place.partial / CHECKPOINT).mkdir()
    place.note("abc", 12.5)
    again = workspace.Workspace(tmp_path / "key")
    assert (again.open(), again.run_id, again.seconds) == (True, "abc", 12.5)
    (tmp_path / ".key.attempt").write_text("{torn", encoding="utf-8")
    third = workspace.Workspace(tmp_path / "key")
    assert (third.open(), third.run_id, third.seconds) == (True, None, 0.0)
    shutil.rmtree(place.partial)
