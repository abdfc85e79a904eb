"""Other commands for stored transitions: what they would have been paid for another speed is a closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from romgrl.algorithms.commanded_windows import WindowColumns
from romgrl.algorithms.replay_buffer import Batch

Paid = Callable[[Tensor, Tensor], Tensor]
NEAR = 0.3
"""Deviation, m/s, of a new command from the speed that was achieved, which itself swings within a stride."""


class Relabelling:
    """Exchanges the command of a share of the transitions of a batch: one c' for all n steps, in s, s' and the rewards.

    Half of them are asked for the speed that they had, NEAR about it, in their own gait; the other half for any gait
    and speed of `ranges` (G, 2), m/s, which a curriculum may change.
    `paid`: the reward (...) for the speed of velocities and commands (...), m/s, as the environment pays it, of which
    it has the share `weight`.
    """

    def __init__(
        self, columns: WindowColumns, ranges: Tensor, paid: Paid, *, share: float, seed: int, weight: float = 1.0
    ) -> None:
        self.columns, self.ranges, self.paid = columns, ranges, paid
        self.share, self.weight = share, weight
        self.generator = torch.Generator(device=ranges.device).manual_seed(seed)

    def apply_(self, batch: Batch) -> None:
        """In place. The command of an observation (B, O) is in its last columns."""
        chosen, asked = self._drawn(batch.windows[:, 0])
        commands, row = self.columns.commands, chosen[:, None]
        seen = asked.shape[1]
        for observation in (batch.observation, batch.next_observation):
            observation[:, -seen:] = torch.where(row, asked, observation[:, -seen:])
        velocity, before = batch.windows[..., -1], self.columns.speed(batch.windows)
        change = self.paid(velocity, asked[:, :1].expand_as(velocity)) - self.paid(velocity, before)
        batch.task_reward += row * (self.weight * change)
        batch.windows[..., commands] = torch.where(row[..., None], asked[:, None], batch.windows[..., commands])

    def _drawn(self, first: Tensor) -> tuple[Tensor, Tensor]:
        """Which transitions (B,) have another command, and which (B, K), of their commanded windows (B, W + K + 1)."""
        gaits, device = self.columns.gaits, first.device
        chosen, near, place = torch.rand((3, len(first)), generator=self.generator, device=device)
        far = torch.randint(gaits, (len(first),), generator=self.generator, device=device)
        spread = NEAR * torch.randn(len(first), generator=self.generator, device=device)
        gait = torch.where(near < 0.5, self.columns.gait(first), far)
        low, high = self.ranges[gait].T
        speed = torch.where(near < 0.5, torch.clamp(first[:, -1] + spread, low, high), low + place * (high - low))
        asked = first[:, self.columns.commands].clone()
        asked[:, 0], asked[:, 1:-1] = speed, torch.nn.functional.one_hot(gait, gaits)
        return chosen < self.share, asked

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        return {"generator": self.generator.get_state(), "ranges": self.ranges}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.generator.set_state(state["generator"])
        self.ranges.copy_(state["ranges"])
