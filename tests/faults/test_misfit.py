"""An artifact that is whole but does not fit is named, with what it has and what is needed, before any training."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms import sac
from romgrl.artifacts import save_tensors
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.humanoid import model
from romgrl.humanoid.model import configured
from romgrl.stages import evaluation, report, student
from romgrl.stages.rollouts import teacher as teacher_rollouts
from tests.helpers.stage_inputs import STEPS, Arrays, Bench, teacher
from tests.helpers.walkers import write_walker


def features(value: Any = None, *, columns: int = 5, kind: type = np.float32) -> Arrays:
    array = np.zeros((STEPS, columns), kind)
    if value is not None:
        array[7, 2] = value
    return {"features": array}


def exchanged() -> Arrays:
    return {"channels": np.array([CHANNELS[i] for i in (0, 3, 4, 1, 2)])}


def short() -> Arrays:
    return {"episode": np.arange(STEPS, dtype=np.int32) // 3}


def mse(bench: Bench, change: Callable[[pd.DataFrame], pd.DataFrame], name: str = "mse") -> None:
    bench.table(name, change(pd.read_csv(bench.inputs["evaluation"] / f"{name}.csv")))


def taller(bench: Bench) -> None:
    other = replace(bench.config, humanoid=replace(bench.config.humanoid, height=1.9))
    write_walker(bench.inputs["student"] / "policy.safetensors", humanoid=model.identity(configured(other.humanoid)))


WORK = ((student, "train_student"), (evaluation, "roll_out"), (teacher_rollouts, "record"), (report, "draw_figures"))


Spoil = Callable[[Bench], object]


REFERENCE: dict[str, tuple[Spoil, str]] = {
    "four columns": (lambda b: b.reference(**features(columns=4)), "float32 (360, 4); needed: float32 (360, 5)"),
    "six columns": (lambda b: b.reference(**features(columns=6)), "float32 (360, 6); needed: float32 (360, 5)"),
    "one axis": (lambda b: b.reference(features=np.zeros(360, np.float32)), "float32 (360,); needed"),
    "float64": (lambda b: b.reference(**features(kind=np.float64)), "features is float64"),
    "whole numbers": (lambda b: b.reference(**features(kind=np.int32)), "features is int32"),
    "objects": (lambda b: b.reference(**features(kind=object)), "Object arrays cannot be loaded"),
    "no episodes": (lambda b: b.reference(episode=None), "no array episode"),
    "no time step": (lambda b: b.reference(dt=None, speed=None), "no array dt, speed"),
    "other numbering": (
        lambda b: b.reference(episode=np.zeros(9, np.int32)),
        "episode is int32 (9,); needed: int32 (360",
    ),
    "nan": (lambda b: b.reference(**features(np.nan)), "features holds numbers that are not finite"),
    "inf": (lambda b: b.reference(**features(np.inf)), "features holds numbers that are not finite"),
    "nan in velocity": (lambda b: b.reference(velocity=np.full(360, np.nan, np.float32)), "velocity holds numbers"),
    "power of two worlds": (lambda b: b.reference(power=np.ones((360, 2), np.float32)), "power is float32 (360, 2)"),
    "contact of one foot": (lambda b: b.reference(contact=np.ones((360, 1), bool)), "contact is bool (360, 1)"),
    "50 Hz": (lambda b: b.reference(dt=np.float32(0.02)), "dt 0.02; needed: 0.0333333"),
    "three metres per second": (lambda b: b.reference(speed=np.float32(3.0)), "speed 3; needed: 4"),
    "two speeds": (lambda b: b.reference(speed=np.full(2, 4.0, np.float32)), "speed nan; needed: 4"),
    "feet exchanged": (
        lambda b: b.reference(**exchanged()),
        "channels pelvis_y, right_foot_x, right_foot_z, left_foot_x",
    ),
    "empty": (
        lambda b: b.reference(
            features=np.zeros((0, 5), np.float32), episode=np.zeros(0, np.int32), velocity=None, contact=None
        ),
        "the longest episode has 0 steps",
    ),
}


CASES: dict[str, tuple[str, str, Spoil, str]] = {
    **{name: ("student", "reference/reference.npz", *case) for name, case in REFERENCE.items()},
    "short episodes": (
        "evaluation",
        "reference/reference.npz",
        lambda b: b.reference(**short()),
        "3 steps; needed: 50",
    ),
    "the teacher's policy for the humanoid": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: teacher(b.inputs["student"] / "policy.safetensors"),
        "algorithm ppo; needed: sac",
    ),
    "the student's policy for the model": (
        "reference",
        "teacher/policy.safetensors",
        lambda b: write_walker(b.inputs["teacher"] / "policy.safetensors", humanoid="x"),
        "algorithm sac; needed: ppo",
    ),
    "twenty actions": (
        "evaluation",
        "baseline/policy.safetensors",
        lambda b: write_walker(b.inputs["baseline"] / "policy.safetensors", actions=20, humanoid=b.fingerprint),
        "20 actions; needed: 21",
    ),
    "observations that are not there": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: write_walker(b.inputs["student"] / "policy.safetensors", columns=400, humanoid=b.fingerprint),
        "columns from 390 to 399; needed: below 358",
    ),
    "another humanoid": ("evaluation", "student/policy.safetensors", taller, "trained on another humanoid: standing "),
    "no humanoid": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", network={"humanoid": None}),
        "trained on another humanoid: it does not say which; this one: mass 71.8 kg, ",
    ),
    "hidden sizes of another": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", network={"hidden_sizes": [9]}),
        "policy.weight_0 is torch.float32 (1, 10, 8); needed: torch.float32 (1, 10, 9)",
    ),
    "a layer more": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", network={"hidden_sizes": [8, 8]}),
        "no tensor policy.bias_2, policy.weight_2",
    ),
    "a tensor less": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", drop="policy.bias_1"),
        "no tensor policy.bias_1",
    ),
    "a tensor more": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", extra=torch.ones(1)),
        "an unknown tensor extra",
    ),
    "double precision": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", observation_mean=torch.zeros(10, dtype=torch.float64)),
        "observation_mean is torch.float64",
    ),
    "weights that are not finite": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: b.policy("student", observation_scale=torch.full((10,), torch.nan)),
        "observation_scale holds numbers that are not finite",
    ),
    "no description": (
        "evaluation",
        "student/policy.safetensors",
        lambda b: save_tensors(b.inputs["student"] / "policy.safetensors", {"w": torch.ones(1)}, {}),
        "does not describe its network",
    ),
    "a description of something else": (
        "reference",
        "teacher/policy.safetensors",
        lambda b: b.policy("teacher", network={"memory": 3}),
        "description of the network",
    ),
    "thirteen observations": (
        "reference",
        "teacher/policy.safetensors",
        lambda b: teacher(b.inputs["teacher"] / "policy.safetensors", observation=13),
        "input_size 13; needed: 20",
    ),
    "another teacher": (
        "reference",
        "teacher/policy.safetensors",
        lambda b: teacher(b.inputs["teacher"] / "policy.safetensors", hidden=16),
        "hidden_sizes [16, 16]; needed: [32, 32]",
    ),
    "another activation": (
        "reference",
        "teacher/policy.safetensors",
        lambda b: teacher(b.inputs["teacher"] / "policy.safetensors", activation="elu"),
        "activation elu; needed: ",
    ),
    "rollouts of more episodes": (
        "report",
        "evaluation/rollouts.npz",
        lambda b: b.rollouts(student_upright=np.ones((9, 100), bool)),
        "student_upright is bool (9, 100); needed: bool (2, 100)",
    ),
    "states of something else": (
        "report",
        "evaluation/rollouts.npz",
        lambda b: b.rollouts(baseline_states=np.zeros((100, 46), np.float32)),
        "baseline_states is float32 (100, 46); needed: float32 (100, 48)",
    ),
    "no error column": (
        "report",
        "evaluation/mse.csv",
        lambda b: mse(b, lambda table: table.drop(columns=["student", "note"])),
        "no column student, note",
    ),
    "no gait column": (
        "report",
        "evaluation/gait.csv",
        lambda b: mse(b, lambda table: table.drop(columns="trunk_lean_deg"), "gait"),
        "no column trunk_lean_deg",
    ),
    "no distance column": (
        "report",
        "evaluation/distances.csv",
        lambda b: mse(b, lambda table: table.drop(columns=["teacher_floor", "unit"]), "distances"),
        "no column teacher_floor, unit",
    ),
    "no column of null models": (
        "report",
        "evaluation/null_models.csv",
        lambda b: mse(b, lambda table: table.drop(columns="measure"), "null_models"),
        "no column measure",
    ),
    "no rows": ("report", "evaluation/gait.csv", lambda b: mse(b, lambda table: table[:0], "gait"), "no rows"),
    "an empty table": (
        "report",
        "evaluation/mse.csv",
        lambda b: (b.inputs["evaluation"] / "mse.csv").write_text("", encoding="utf-8"),
        "cannot be read",
    ),
}


def test_every_misfit_is_named_before_any_training(
    smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name in WORK:
        monkeypatch.setattr(module, name, lambda *_, **__: pytest.fail("it was used"))
    named = 0
    for case, (stage, file, spoil, message) in CASES.items():
        bench = Bench(smoke_config, tmp_path / case.replace(" ", "-").replace("'", ""))
        spoil(bench)
        with pytest.raises(ArtifactError) as caught:
            bench.run(stage)
        assert str(caught.value).startswith(f"{bench.directory / file}: "), f"{case}: {caught.value}"
        assert message in str(caught.value), f"{case}: {caught.value}"
        assert (len(str(caught.value).splitlines()), caught.value.exit_code) == (1, 3)
        named += 1
    assert named == len(CASES) == 45
    print(f"{named} of {len(CASES)} artifacts that do not fit named")


@pytest.mark.parametrize("stage", ["student", "evaluation", "reference", "report"])
def test_what_fits_is_used(smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str) -> None:
    """The same inputs, not spoiled, are refused by nothing."""

    def used(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    for module, name in WORK:
        monkeypatch.setattr(module, name, used)
    with pytest.raises(ZeroDivisionError):
        Bench(smoke_config, tmp_path / "bench").run(stage)


def test_another_humanoid_is_told_in_words(tmp_path: Path) -> None:
    """What the policy was trained on and what there is now; of policies of old only the latter is known."""
    path, now = tmp_path / "policy.safetensors", model.identity(model.build(mass=95.0))
    write_walker(path, humanoid=model.identity(model.build(mass=71.8)))
    with pytest.raises(ArtifactError) as error:
        sac.load_sac_policy(path, humanoid=now)
    assert str(error.value) == f"{path}: trained on another humanoid: mass 71.8 kg in training, 95 kg now"
    write_walker(path, humanoid=now | {"fingerprint": "of other names"})
    with pytest.raises(ArtifactError, match=r"another humanoid: other joints or actuators, or other names of them$"):
        sac.load_sac_policy(path, humanoid=now)
    write_walker(path, humanoid=model.fingerprint(model.build()))
    with pytest.raises(ArtifactError, match=r"another humanoid: it does not say which; this one: mass 95 kg, "):
        sac.load_sac_policy(path, humanoid=now)
    write_walker(path, humanoid=now["fingerprint"])
    sac.load_sac_policy(path, humanoid=now)
