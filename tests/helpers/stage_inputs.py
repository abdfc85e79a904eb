"""The inputs of every stage, small ones that fit, and ways to spoil them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from romgrl.algorithms import ppo, ppo_policy
from romgrl.artifacts import load_tensors, save_arrays, save_tensors
from romgrl.config.schema import Config
from romgrl.gait.features import CHANNELS
from romgrl.gait.null_models import NULL_COLUMNS
from romgrl.humanoid import model
from romgrl.humanoid.model import configured
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import evaluation, reference, report, student
from romgrl.stages.wiring.artifact_arrays import DISTANCE_COLUMNS
from tests.helpers.synthetic_gait import DT, run
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
    ppo_policy.save_ppo_policy(path, learner)


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
        self.table("null_models", pd.DataFrame([["statue", "mmd", "all", 1.0]], columns=NULL_COLUMNS))
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
