"""What the teacher and the reference need of a reduced-order model, whatever its mechanics."""

from __future__ import annotations

from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from romgrl.gait.symmetry import Mirror

Array = NDArray[Any]


class RomVectorEnv(Protocol):
    """N worlds of one reduced-order model, stepped together; a Gymnasium vector environment that resets in the step.

    Observations (N, O) and actions (N, A) in [-1, 1] are float32; `observation_names` are those of the O columns, and
    the mirrors exchange left and right. `dt`: s per control step. `parameters` has at least `mass`, kg, `leg_length`
    and `foot_radius`, m. `info` of a step holds, from before an autoreset and for all worlds, "features" (N, 5) m of
    `romgrl.gait.features`, "forward_velocity" (N,) m/s, "contact" (N, 2) bool of the left and the right foot,
    "diverged" (N,) bool and "final_obs" (N, O); where it can tell, POWERS of `romgrl.gait.features`, (N,) W.
    """

    num_envs: int
    dt: float
    parameters: Any
    observation_names: tuple[str, ...]
    mirror_observation: Mirror
    mirror_action: Mirror
    single_observation_space: gymnasium.Space[Any]
    single_action_space: gymnasium.Space[Any]

    def reset(self, *, seed: int | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode in all worlds; a seed fixes all that follows."""
        ...

    def step(self, actions: Array, /) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Observation, reward (N,), terminated (N,), truncated (N,) and info of one control step."""
        ...

    def save(self) -> NDArray[np.float64]:
        """State (N, S) of all worlds, random streams included."""
        ...

    def restore(self, states: NDArray[np.float64], /) -> tuple[Array, dict[str, Any]]:
        """Go on from a state of `save`, bit for bit; ValueError for what is none."""
        ...

    def close(self) -> None:
        """Free what the worlds hold."""
        ...
