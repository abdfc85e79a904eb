"""An artifact that is whole but does not fit is named, with what it has and what is needed, before any training."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms import ppo, sac
from romgrl.artifacts import load_tensors, save_arrays, save_tensors
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.humanoid import model
from romgrl.humanoid.model import configured
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import evaluation, reference, report, student
from romgrl.stages.wiring.artifact_arrays import DISTANCE_COLUMNS
from tests.gait.synthetic import DT, run
from tests.helpers.walkers import write_walker

Arrays = dict[str, Any]
STEPS = 360


def reference_arrays() -> Arrays:
    features, contact = run(episodes=3, steps=120, frequency=1.75)
    return {
        "features": features.reshape(-1, 5).astype(np.float32),
        "episode": np.repeat(np.arange(3, dtype=np.int32), 120),
        "contact": contact.reshape(-1, 2),
        "velocity": np.full(STEPS, 4.0, np.float32),
        "channels": np.array(CHANNELS),
        "dt": np.float32(DT),
        "speed": np.float32(4.0),
    }


def rollout_arrays(config: Config) -> Arrays:
    size = (config.evaluation.episodes, config.evaluation.steps)
    arrays: Arrays = {"dt": np.float32(DT), "channels": np.array(CHANNELS)}
    for name in ("student", "baseline"):
        arrays[f"{name}_features"] = np.zeros((*size, 5), np.float32)
        arrays[f"{name}_velocity"] = np.zeros(size, np.float32)
        arrays[f"{name}_upright"] = np.ones(size, bool)
        arrays[f"{name}_states"] = np.zeros((size[1], 48), np.float32)
    return arrays


def teacher(path: Path, *, observation: int = 20, hidden: int = 32, activation: str = "tanh") -> None:
    learner = ppo.PPO(
        observation_size=observation,
        action_size=2,
        hidden_sizes=[hidden, hidden],
        activation=activation,
        learning_rate=1e-3,
        gamma=0.99,
        gae_lambda=0.95,
        clip_ratio=0.2,
        epochs=1,
        minibatch_size=8,
        value_coefficient=0.5,
        entropy_coefficient=0.0,
        max_gradient_norm=1.0,
        initial_log_std=0.0,
    )
    ppo.save_policy(path, learner)


class Bench:
    """The inputs of every stage, all of which fit."""

    def __init__(self, config: Config, directory: Path) -> None:
        self.config, self.directory = config, directory
        self.inputs = {name: directory / name for name in ("teacher", "reference", "student", "baseline", "evaluation")}
        for path in self.inputs.values():
            path.mkdir(parents=True)
        self.fingerprint = model.fingerprint(configured(config.humanoid))
        save_arrays(self.inputs["reference"] / "reference.npz", reference_arrays())
        save_arrays(self.inputs["evaluation"] / "rollouts.npz", rollout_arrays(config))
        teacher(self.inputs["teacher"] / "policy.safetensors", activation=config.teacher.activation)
        for name in ("student", "baseline"):
            write_walker(self.inputs[name] / "policy.safetensors", humanoid=self.fingerprint)
        columns = ["channel", "alignment", "baseline", "student", "reduction_percent", "teacher_floor", "note"]
        self.table("mse", pd.DataFrame([["average", "raw", 1.0, 1.0, 0.0, 0.0, "ok"]], columns=columns))
        columns = ["walker", "episodes", "falls", "steady_speed_m_per_s", "stride_frequency_hz", "trunk_lean_deg"]
        self.table("distances", pd.DataFrame([["mmd", "all", *[0.0] * 6, "1", "ok"]], columns=DISTANCE_COLUMNS))
        self.table("gait", pd.DataFrame([["student", 1, 0, 4.0, 1.7, 5.0]], columns=columns))

    def table(self, name: str, table: pd.DataFrame) -> None:
        table.to_csv(self.inputs["evaluation"] / f"{name}.csv", index=False)

    def reference(self, **values: Any) -> None:
        """Another reference.npz, as somebody else's program may write it; None leaves an array out."""
        arrays = {name: value for name, value in (reference_arrays() | values).items() if value is not None}
        np.savez(self.inputs["reference"] / "reference.npz", **arrays)

    def rollouts(self, **values: Any) -> None:
        np.savez(self.inputs["evaluation"] / "rollouts.npz", **(rollout_arrays(self.config) | values))

    def policy(self, stage: str, *, drop: str = "", network: Any = None, **tensors: torch.Tensor) -> None:
        """Another policy.safetensors with some tensors or the description changed."""
        path = self.inputs[stage] / "policy.safetensors"
        old, metadata = load_tensors(path)
        described = {**json.loads(metadata["network"]), **(network or {})}
        kept = {name: tensor for name, tensor in (old | tensors).items() if name != drop}
        save_tensors(path, kept, {"network": json.dumps(described)} if network != "none" else {})

    def run(self, stage: str) -> None:
        entry = {"student": student, "evaluation": evaluation, "reference": reference, "report": report}[stage]
        output = self.directory / "output"
        output.mkdir()
        entry.run(self.config, self.inputs, output, SilentLog())


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


WORK = ((student, "train_student"), (evaluation, "roll_out"), (reference, "record"), (report, "draw_figures"))
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
    for module, name in (
        (student, "train_student"),
        (evaluation, "roll_out"),
        (reference, "record"),
        (report, "draw_figures"),
    ):
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
    assert named == len(CASES) == 43
    print(f"{named} of {len(CASES)} artifacts that do not fit named")


@pytest.mark.parametrize("stage", ["student", "evaluation", "reference", "report"])
def test_what_fits_is_used(smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str) -> None:
    """The same inputs, not spoiled, are refused by nothing."""

    def used(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    for module, name in (
        (student, "train_student"),
        (evaluation, "roll_out"),
        (reference, "record"),
        (report, "draw_figures"),
    ):
        monkeypatch.setattr(module, name, used)
    with pytest.raises(ZeroDivisionError):
        Bench(smoke_config, tmp_path / "bench").run(stage)


def test_a_fingerprint_knows_the_humanoid() -> None:
    human = model.fingerprint(model.build())
    assert human == model.fingerprint(model.build(actuation="torque", substeps=16, control_frequency=60.0))
    assert human not in {model.fingerprint(model.build(height=1.75)), model.fingerprint(model.build(mass=73.5))}


def test_another_humanoid_is_told_in_words(tmp_path: Path) -> None:
    """What the policy was trained on and what there is now; of policies of old only the latter is known."""
    path, now = tmp_path / "policy.safetensors", model.identity(model.build(mass=95.0))
    write_walker(path, humanoid=model.identity(model.build(mass=71.8)))
    with pytest.raises(ArtifactError) as error:
        sac.load_policy(path, humanoid=now)
    assert str(error.value) == f"{path}: trained on another humanoid: mass 71.8 kg in training, 95 kg now"
    write_walker(path, humanoid=now | {"fingerprint": "of other names"})
    with pytest.raises(ArtifactError, match="another humanoid: other names of bodies, joints or actuators"):
        sac.load_policy(path, humanoid=now)
    write_walker(path, humanoid=model.fingerprint(model.build()))
    with pytest.raises(ArtifactError, match=r"another humanoid: it does not say which; this one: mass 95 kg, "):
        sac.load_policy(path, humanoid=now)
    write_walker(path, humanoid=now["fingerprint"])
    sac.load_policy(path, humanoid=now)
