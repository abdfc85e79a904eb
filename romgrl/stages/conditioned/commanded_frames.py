"""Windows of gait frames beside the command in force and the forward velocity, as the replay buffer keeps them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from romgrl.gait.discriminator_windows import Float32, FrameWindows, WindowLayout
from romgrl.gait.symmetry import Mirror, unsigned
from romgrl.humanoid.task import SLOWEST


class CommandedFrames(FrameWindows):
    """As `FrameWindows`; a frame has the command and the velocity of its step behind the layout's columns."""

    def frame(self, info: Mapping[str, Any], prefix: str = "") -> Float32:
        """A control step (N, positions + K + 1); prefix "reset_" for the one after a reset, which has no velocity."""
        velocity = np.zeros_like(info["forward_velocity"]) if prefix else info["forward_velocity"]
        return np.column_stack((super().frame(info, prefix), info[f"{prefix}command"], velocity))

    def restart(self, frame: Float32, rows: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Fill the windows of `rows` with their first step, as if they had stood there."""
        super().restart(frame[:, : self.layout.positions], rows)

    def push(self, frame: Float32) -> Float32:
        """Append the newest step; returns the commanded windows (N, W + K + 1)."""
        positions = self.layout.positions
        return np.concatenate((super().push(frame[:, :positions]), frame[:, positions:]), axis=1)


def commanded_mirror(layout: WindowLayout, size: int) -> Mirror:
    """Mirror of a commanded window (size,): command and velocity are what they are on either side."""
    window = np.asarray(layout.mirror().permutation)
    return unsigned(np.concatenate((window, np.arange(len(window), size))))


def speed_payment(alpha: float | None) -> Callable[[Tensor, Tensor], Tensor]:
    """`romgrl.humanoid.task.speed_reward` of tensors: of velocities and target speeds (...), m/s."""

    def paid(velocity: Tensor, speed: Tensor) -> Tensor:
        sensitivity = 4.0 / speed.clamp(min=SLOWEST) if alpha is None else alpha
        return torch.exp(-sensitivity * (velocity - speed).abs())

    return paid
