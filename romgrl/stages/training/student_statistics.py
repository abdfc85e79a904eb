"""What the humanoids did while the student learned."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class StudentTally:
    """Sums over the steps since the last `take`."""

    def __init__(self, num_envs: int, control_frequency: float) -> None:
        self.length = np.zeros(num_envs)
        self.control_frequency = control_frequency
        self.episode_seconds = self.fall_share = 0.0
        self._clear()

    def _clear(self) -> None:
        self.steps = self.episodes = self.falls = self.diverged = 0
        self.speed = self.lean = self.finished_length = 0.0

    def add(
        self, info: Mapping[str, NDArray[np.float32]], terminated: NDArray[np.bool_], finished: NDArray[np.bool_]
    ) -> None:
        """Take in one step of all environments."""
        self.length += 1
        self.steps += 1
        self.speed += float(info["forward_velocity"].mean())
        self.lean += float(info["trunk_lean"].mean())
        self.diverged += int(info["diverged"].sum())
        if finished.any():
            self.episodes += int(finished.sum())
            self.falls += int(terminated.sum())
            self.finished_length += float(self.length[finished].sum())
            self.length[finished] = 0

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        return dict(vars(self))

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        length = np.asarray(state["length"])
        vars(self).update(state, length=length)

    def take(self) -> dict[str, float]:
        """Means since the last call; of the last finished episodes where none has finished since."""
        if self.episodes:
            self.episode_seconds = self.finished_length / self.episodes / self.control_frequency
            self.fall_share = self.falls / self.episodes
        values = {
            "speed": self.speed / max(1, self.steps),
            "trunk_lean_degrees": math.degrees(self.lean / max(1, self.steps)),
            "episode_seconds": self.episode_seconds,
            "fall_share": self.fall_share,
            "diverged": float(self.diverged),
        }
        self._clear()
        return values
