"""What PPO collects between two updates, and its advantages (generalised advantage estimation)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


def compute_gae(
    rewards: Tensor,
    values: Tensor,
    next_values: Tensor,
    terminated: Tensor,
    truncated: Tensor,
    gamma: float,
    gae_lambda: float,
    segment_steps: int | None = None,
) -> tuple[Tensor, Tensor]:
    """Advantages and returns, (T, N) each, from (T, N) inputs (Schulman et al. 2016, eq. 16).

    `next_values` are the values of the observations that each step led to, before any reset. A terminated step has no
    future; a truncated one keeps its bootstrap value, and no advantage flows back across either, nor across the end of
    a segment of `segment_steps` steps: its value takes the place of what comes after.
    """
    deltas = rewards + gamma * next_values * ~terminated - values
    decay = gamma * gae_lambda * ~(terminated | truncated)
    if segment_steps is not None:
        decay[segment_steps - 1 :: segment_steps] = 0.0
    advantages = torch.empty_like(deltas)
    advantage = torch.zeros_like(deltas[0])
    for step in reversed(range(len(deltas))):
        advantage = deltas[step] + decay[step] * advantage
        advantages[step] = advantage
    return advantages, advantages + values


class Rollout:
    """Preallocated storage of `steps` steps of `num_envs` environments; every tensor is (steps, num_envs, ...)."""

    def __init__(
        self, *, steps: int, num_envs: int, observation_size: int, action_size: int, device: str = "cpu"
    ) -> None:
        shape = (steps, num_envs)
        self.observations = torch.zeros((*shape, observation_size), device=device)
        self.next_observations = torch.zeros_like(self.observations)
        self.actions = torch.zeros((*shape, action_size), device=device)
        self.log_probabilities = torch.zeros(shape, device=device)
        self.rewards = torch.zeros(shape, device=device)
        self.terminated = torch.zeros(shape, dtype=torch.bool, device=device)
        self.truncated = torch.zeros(shape, dtype=torch.bool, device=device)

    def store_action(self, step: int, observation: Tensor, action: Tensor, log_probability: Tensor) -> None:
        """What the policy saw and did at `step`."""
        self.observations[step] = observation
        self.actions[step] = action
        self.log_probabilities[step] = log_probability

    def store_outcome(
        self,
        step: int,
        reward: NDArray[np.floating],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        next_observation: NDArray[np.float32],
    ) -> None:
        """What the environments answered; `next_observation` (N, O) is the one before any reset."""
        self.rewards[step] = torch.from_numpy(reward)
        self.terminated[step] = torch.from_numpy(terminated)
        self.truncated[step] = torch.from_numpy(truncated)
        self.next_observations[step] = torch.from_numpy(next_observation)
