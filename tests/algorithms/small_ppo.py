"""A small PPO, a rollout for it, and its networks as torch would write them."""

from __future__ import annotations

from typing import Any

import torch

from romgrl.algorithms.ppo import (
    PPO,
)
from romgrl.algorithms.rollout_buffer import Rollout
from tests.helpers.automatic_gradients import forward_by_autograd


def make_ppo(**changes: Any) -> PPO:
    settings: dict[str, Any] = {
        "observation_size": 3,
        "action_size": 2,
        "hidden_sizes": [16, 16],
        "activation": "tanh",
        "learning_rate": 1e-3,
        "gamma": 0.9,
        "gae_lambda": 0.8,
        "clip_ratio": 0.2,
        "epochs": 2,
        "minibatch_size": 16,
        "value_coefficient": 0.5,
        "entropy_coefficient": 0.0,
        "max_gradient_norm": 0.5,
        "initial_log_std": -0.5,
    }
    return PPO(**(settings | changes))


def filled_rollout(seed: int = 0) -> Rollout:
    generator = torch.Generator().manual_seed(seed)
    rollout = Rollout(steps=8, num_envs=4, observation_size=3, action_size=2)
    for tensor in (rollout.observations, rollout.next_observations, rollout.actions, rollout.rewards):
        tensor.normal_(generator=generator)
    return rollout


def networks(ppo: PPO, weights: torch.Tensor, observations: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Means and log standard deviation of the actions, and values, differentiable by the learner's `weights`."""
    activation = str(ppo.spec["activation"])
    policy, value, log_std = weights.split([len(ppo.policy.flat), len(ppo.value.flat), len(ppo.log_std)])
    flat = observations.flatten(0, -2)
    mean = forward_by_autograd(ppo.policy, activation, policy, flat).view(*observations.shape[:-1], -1)
    return mean, log_std, forward_by_autograd(ppo.value, activation, value, flat).view(observations.shape[:-1])


def normal(mean: torch.Tensor, log_std: torch.Tensor) -> torch.distributions.Independent:
    return torch.distributions.Independent(torch.distributions.Normal(mean, log_std.exp()), 1)
