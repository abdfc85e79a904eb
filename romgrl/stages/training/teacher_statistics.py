"""What the reduced-order models did while the teacher learned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.artifacts.checkpoint import State
from romgrl.gait.features import LEFT_X, RIGHT_X


class TeacherTally:
    """What the log says of one rollout of `steps` steps."""

    def __init__(self, num_envs: int, steps: int) -> None:
        self.episode_return, self.length = np.zeros(num_envs), np.zeros(num_envs)
        self.feet = np.zeros((steps, num_envs, 2), np.float32)
        self.velocity = np.zeros((steps, num_envs), np.float32)
        self.finished: list[tuple[float, float]] = []
        self.falls = 0

    def add(
        self,
        step: int,
        reward: NDArray[np.float32],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        info: Mapping[str, Any],
    ) -> None:
        """Take in one step of all environments."""
        self.feet[step] = info["features"][:, [LEFT_X, RIGHT_X]]
        self.velocity[step] = info["forward_velocity"]
        self.episode_return += reward
        self.length += 1
        done = terminated | truncated
        if done.any():
            self.finished += zip(self.episode_return[done].tolist(), self.length[done].tolist(), strict=True)
            self.falls += int(terminated.sum())
            self.episode_return[done] = self.length[done] = 0.0

    def state(self) -> State:
        """Everything that `restore` needs between two rollouts."""
        return {"episode_return": self.episode_return, "length": self.length}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        self.episode_return[:] = state["episode_return"]
        self.length[:] = state["length"]

    def take(self) -> dict[str, float]:
        """Means over the rollout; `episode_return` and `episode_length` only if an episode ended in it."""
        centred = self.feet - self.feet.mean(axis=0)
        spread = np.sqrt((centred**2).sum(axis=0).prod(axis=-1)) + 1e-9
        values = {
            "speed": float(self.velocity.mean()),
            "left_right_correlation": float((centred.prod(axis=-1).sum(axis=0) / spread).mean()),
            "falls": float(self.falls),
        }
        if self.finished:
            returns, lengths = np.mean(self.finished, axis=0)
            values |= {"episode_return": float(returns), "episode_length": float(lengths)}
        self.finished, self.falls = [], 0
        return values
