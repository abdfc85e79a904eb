"""A training that was cut anywhere and goes on ends with the bits of one that was not."""

from __future__ import annotations

import random
import shutil
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from romgrl.artifacts.checkpoint import CHECKPOINT, Checkpoints, flatten_state, nest
from romgrl.config.schema import Config
from romgrl.stages import student
from romgrl.stages.training.checkpoints import TrainingCheckpoints
from romgrl.stages.training.student_statistics import StudentTally
from tests.conftest import Composer
from tests.helpers.cut_trainings import TOTAL, Recorder, digest, files, interrupt, train, training


@pytest.mark.parametrize("count", [1, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["teacher", "student"])
def test_resume_is_bit_exact(
    name: str, count: int, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Networks, targets, optimisers, temperature, discriminator, normaliser, buffer, environments, random streams."""
    config = training(name, compose_config)
    recorder = Recorder(monkeypatch)
    train(name, config, tmp_path / "whole")
    whole, passes = (recorder.state, files(tmp_path / "whole")), recorder.steps
    cuts, equal = random.Random(0).sample(passes[:-1], count), 0
    for cut in cuts:
        output = tmp_path / f"cut-{cut}"
        assert interrupt(name, config, output, recorder, cut) == cut
        train(name, config, output)
        assert recorder.steps == [step for step in passes if step > cut]
        assert (recorder.state, files(output)) == whole, f"cut at step {cut}"
        equal += 1
        shutil.rmtree(output / CHECKPOINT)
    print(f"{name}: cut at {sorted(cuts)} of {TOTAL[name]}: {equal} of {count} end with the same bits")


@pytest.mark.slow
def test_a_student_with_another_discriminator_goes_on_bit_exactly(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rewards stored in the buffer, a critic's level, velocities and frames that are apart."""
    other = ("loss=wasserstein", "reward=stored", "features=trunk_velocities", "window=3", "stride=4")
    config = training("student", compose_config, *(f"discriminator.{choice}" for choice in other))
    config.student.total_steps = 1600
    recorder = Recorder(monkeypatch)
    train("student", config, tmp_path / "whole")
    whole = (recorder.state, files(tmp_path / "whole"))
    interrupt("student", config, tmp_path / "cut", recorder, 1000)
    train("student", config, tmp_path / "cut")
    assert (recorder.state, files(tmp_path / "cut")) == whole


@pytest.mark.parametrize("name", ["teacher", pytest.param("student", marks=pytest.mark.slow)])
def test_every_part_of_the_state_matters(
    name: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Go on without one number or array of the state after the other: none of these ends with the same bits."""
    config = training(name, compose_config)
    recorder = Recorder(monkeypatch)
    train(name, config, tmp_path / "whole")
    whole = (recorder.state, files(tmp_path / "whole"))
    leaves, left = list[str](), list[str]()
    for cut in LATE[name]:  # what did not matter after the first may after another
        output = tmp_path / f"{cut}"
        interrupt(name, config, output, recorder, cut)
        if not leaves:
            leaves = left = leaves_of(output)
        left = [leaf for leaf in left if same_without(leaf, name, config, output, recorder, whole)]
    print(f"{name}: {len(leaves)} parts of the state, {len(leaves) - len(left)} of them matter")
    assert set(left) <= TOLD_AGAIN, left


def test_what_is_told_again_is_kept() -> None:
    """Where no episode ends between two rows of the curve, the second tells of those before the first."""
    tally, info = StudentTally(2, 30.0), {"forward_velocity": np.ones(2), "trunk_lean": np.ones(2)}
    info["diverged"] = np.zeros(2)
    tally.add(info, np.array([True, False]), np.array([True, True]))
    told = tally.take()
    later = StudentTally(2, 30.0)
    later.restore(nest(dict(flatten_state(deepcopy(tally.state())))))
    again = later.take()
    assert {name: again[name] for name in ("episode_seconds", "fall_share")} == {
        "episode_seconds": 1 / 30,
        "fall_share": 0.5,
    }
    assert told["fall_share"] == again["fall_share"]


@pytest.mark.slow
def test_columns_of_the_curve_do_not_depend_on_a_cut(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut after the first update, before the first row that tells of one."""
    config = training("student", compose_config, "student.total_steps=640")
    recorder = Recorder(monkeypatch)
    monkeypatch.setattr(student, "LOG_INTERVAL", 640)
    train("student", config, tmp_path / "whole")
    interrupt("student", config, tmp_path / "cut", recorder, 560)
    train("student", config, tmp_path / "cut")
    header = (tmp_path / "whole" / "curve.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "critic_loss" in header
    assert files(tmp_path / "cut") == files(tmp_path / "whole")


def same_without(
    leaf: str, name: str, config: Config, cut: Path, recorder: Recorder, whole: tuple[str, dict[str, str]]
) -> bool:
    """Tell whether a training that goes on without a leaf of its state ends as if it had it."""
    output = shutil.copytree(cut, cut.parent / "again")
    recorder.again()
    with pytest.MonkeyPatch.context() as patch:
        left_out = leave_out(patch, leaf)
        with suppress(ValueError):  # a buffer that seems to be empty
            train(name, config, output)
    ended = files(output)
    refused = [*output.glob(f"{CHECKPOINT}/*.damaged")]  # without it the checkpoint is none
    shutil.rmtree(output)
    return left_out["differs"] and not refused and (recorder.state, ended) == whole


TOLD_AGAIN = {"tally/episode_seconds", "tally/fall_share"}  # only where no episode ends within a row of the curve
LATE = {"teacher": [7680], "student": [3000, 2744, 2504, 2200, 3192]}


def leaves_of(output: Path) -> list[str]:
    """Names of all numbers and arrays in the newest checkpoint."""
    found = Checkpoints(output / CHECKPOINT, say=print).load()
    assert found is not None
    return [leaf for leaf, _ in flatten_state(found[1])]


def leave_out(patch: pytest.MonkeyPatch, leaf: str) -> dict[str, bool]:
    """Let the next trainings keep their own first value of a leaf; `differs` tells whether that is another one."""
    load, go_on = Checkpoints.load, TrainingCheckpoints.resume
    fresh: dict[str, Any] = {}
    outcome = {"differs": False}

    def remembering(checkpoints: TrainingCheckpoints) -> int:
        fresh.update(flatten_state(deepcopy({name: part.state() for name, part in checkpoints._parts.items()})))
        return go_on(checkpoints)

    def without(checkpoints: Checkpoints) -> tuple[int, dict[str, Any]] | None:
        found = load(checkpoints)
        if found is None or leaf not in fresh:
            return found
        values = dict(flatten_state(found[1]))
        outcome["differs"] = digest({"": values[leaf]}) != digest({"": fresh[leaf]})
        return found[0], nest(values | {leaf: fresh[leaf]})

    patch.setattr(TrainingCheckpoints, "resume", remembering)
    patch.setattr(Checkpoints, "load", without)
    return outcome
