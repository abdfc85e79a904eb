"""Policies for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from romgrl.algorithms.sac import SAC, save_sac_policy


def write_walker(
    path: Path,
    *,
    humanoid: str | dict[str, str],
    seed: int = 0,
    actions: int = 21,
    columns: int = 10,
    names: Sequence[str] | None = None,
) -> None:
    """Save the policy of a small learner that has learned nothing; it reads the ten columns below `columns`."""
    learner = SAC(
        observation_size=10,
        action_size=actions,
        hidden_sizes=[8],
        layer_norm=False,
        policy_learning_rate=1e-3,
        critic_learning_rate=1e-3,
        temperature_learning_rate=1e-3,
        initial_temperature=0.1,
        target_entropy_scale=0.5,
        gamma=0.98,
        tau=0.01,
        policy_delay=2,
        critic_target="mean",
        policy_average=0.9,
        seed=seed,
    )
    save_sac_policy(
        path, learner, torch.arange(columns - 10, columns), torch.zeros(10), torch.ones(10), humanoid, names
    )
