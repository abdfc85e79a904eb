"""A policy's episodes in a vector environment, as a gait."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import POWERS, Gait, until_first_fall

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]

SOURCES = {
    "features": "features",
    "velocity": "forward_velocity",
    "contact": "contact",
    "trunk_lean": "trunk_lean",
    **{power: power for power in POWERS},
    "ground_force": "ground_force",
}
"""What a gait has, by the entry of an environment's `info` that it comes from, where there is one."""


class Worlds(Protocol):
    """What is asked of a vector environment of E worlds that reset within a step."""

    num_envs: int

    def reset(self, *, seed: int) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Observations (E, O)."""

    def step(self, actions: NDArray[np.float32], /) -> tuple[NDArray[np.float32], Any, NDArray[np.bool_], Any, Any]:
        """Observations, rewards, terminated, truncated, info."""


def record(env: Worlds, policy: Policy, *, steps: int, seed: int, dt: float) -> Gait:
    """One episode of `steps` control steps of `dt` s in each world; what follows a fall is marked invalid."""
    upright = np.ones((env.num_envs, steps), bool)
    recorded: dict[str, Any] = {}
    observation, _ = env.reset(seed=seed)
    for step in range(steps):
        observation, _, terminated, _, info = env.step(policy(observation))
        for name in [name for name, source in SOURCES.items() if source in info]:
            values = info[SOURCES[name]]
            if step == 0:
                kind = bool if values.dtype == bool else float
                recorded[name] = np.zeros((env.num_envs, steps, *values.shape[1:]), kind)
            recorded[name][:, step] = values
        upright[:, step] = ~terminated
    valid = until_first_fall(upright)
    return Gait(valid=valid, fallen=~valid[:, -1], dt=dt, **recorded)
