"""Networks, optimisers and replay buffer are made on the device of the configuration.

Told by torch's `meta` device, whose tensors have no content: what is left on the CPU shows. What a GPU computes is not
tested here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from romgrl.artifacts import save_arrays
from romgrl.config.schema import Config
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student, teacher
from romgrl.stages.training import ppo_teacher
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.student_learner import build_student_learner


class CpuGenerator(torch.Generator):
    """A generator on the CPU, whatever the device asked for."""

    def __new__(cls, device: str = "cpu") -> CpuGenerator:
        return super().__new__(cls)


@pytest.fixture
def meta_config(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> Config:
    """A configuration with `device=meta`; random numbers, which that device cannot draw, come from the CPU."""
    monkeypatch.setattr(torch, "Generator", CpuGenerator)
    return replace(smoke_config, device="meta")


def tensors(owner: Any, seen: set[int] | None = None) -> Iterator[tuple[str, torch.Tensor]]:
    """Every tensor that an object of ours holds, in networks and in attributes, with a name."""
    seen = set() if seen is None else seen
    if id(owner) in seen:
        return
    seen.add(id(owner))
    if isinstance(owner, torch.nn.Module):
        yield from owner.named_parameters()
        yield from owner.named_buffers()
    members = owner if isinstance(owner, dict) else getattr(owner, "__dict__", {})
    for name, member in members.items():
        for part in member if isinstance(member, list | tuple) else [member]:
            if isinstance(part, torch.Tensor):
                yield name, part
            elif isinstance(part, torch.nn.Module | dict) or type(part).__module__.startswith("romgrl"):
                yield from ((f"{name}.{inner}", tensor) for inner, tensor in tensors(part, seen))


def test_student(meta_config: Config, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(size=(100, 5)).astype(np.float32)
    reference = {"features": features, "episode": np.zeros(100, np.int32), "dt": 1 / 30, "speed": 4.0}
    save_arrays(tmp_path / "reference.npz", reference)
    env = humanoid_env(meta_config, num_envs=2)
    learner = build_student_learner(meta_config, env, student.window_layout(meta_config), tmp_path)
    found = dict(tensors(learner))
    assert len(found) > 20
    assert {name for name, tensor in found.items() if tensor.device.type != "meta"} == set()


def test_teacher(meta_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def train(config: Config, env: Any, ppo: Any, *others: Any, **named: Any) -> None:
        made.append(ppo)
        raise KeyboardInterrupt

    monkeypatch.setattr(ppo_teacher, "train_teacher", train)
    monkeypatch.setattr(ppo_teacher, "save_ppo_policy", lambda path, ppo, names: None)
    with pytest.raises(KeyboardInterrupt):
        teacher.run(meta_config, {}, tmp_path, SilentLog())
    found = dict(tensors(made[0]))
    assert len(found) > 10
    assert {name for name, tensor in found.items() if tensor.device.type != "meta"} == set()
