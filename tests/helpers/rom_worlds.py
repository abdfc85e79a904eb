"""Worlds of the C++ core as the tests need them: any parameter, any pose, one substep at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import POWERS
from romgrl.rom import _core
from romgrl.rom.vector_env import LEG_MOTOR_POWERS

ENGINE = "box2d"  # the fixture `engine` sets it
GRAVITY = 9.81
SUBSTEPS_PER_SECOND = 480

# Columns of a saved state: x, y, angle, vx, vy, rate of trunk and of the two foot slots; then those of either leg.
TRUNK = slice(0, 6)
FEET = (slice(6, 12), slice(12, 18))
SHORTENING, EXTENSION, EXTENSION_RATE = ([_core.FIRST_LEG + i, _core.FIRST_LEG + _core.LEG_SIZE + i] for i in (1, 4, 5))
WALKER = slice(0, _core.WALKER_SIZE)  # the rest is the episode's


TESTED: dict[str, Any] = {"foot_mass": 0.9, "reset_speed_low": 0.5, "reset_speed_high": 1.1}
TESTED |= {"reset_hip_angle_low": 0.25, "reset_hip_angle_high": 0.40}


def core_parameters(**values: Any) -> _core.Parameters:
    """Parameters of the core with wider resets and heavier feet than its defaults, and some values changed."""
    parameters = _core.Parameters()
    parameters.engine_is_native = ENGINE == "native"
    for name, value in (TESTED | values).items():
        for place in ("speed_low", "speed_high") if name == "speed" else (name,):
            setattr(parameters, place, value)
    return parameters


MOTOR: dict[str, Any] = {"leg_motor": True, "retraction": 0.0, "extension_limit": 1.15}
"""A motor in each leg, and no script."""


def passive(**values: Any) -> _core.Parameters:
    """Springs alone, one control step per substep: no retraction, no damping, and no end of the episode."""
    defaults = {
        "retraction": 0.0,
        "stance_damping": 0.0,
        "swing_damping": 0.0,
        "fall_height": 0.0,
        "episode_steps": 10**6,
        "substeps": 1,
        "control_frequency": float(SUBSTEPS_PER_SECOND),
    }
    return core_parameters(**{**defaults, **values})


def pose(**values: Any) -> _core.Pose:
    """A pose; the legs are vertical and 0.865 m long unless told otherwise."""
    result = _core.Pose()
    result.leg_length = (0.865, 0.865)
    for name, value in values.items():
        setattr(result, name, value)
    return result


class Worlds:
    """A batch with its arrays."""

    def __init__(self, parameters: _core.Parameters, num_worlds: int = 1, num_threads: int = 1) -> None:
        self.batch = _core.Batch(parameters, num_worlds, num_threads)
        n, size = num_worlds, self.batch.observation_size
        self.arrays: dict[str, NDArray[Any]] = {
            "observation": np.zeros((n, size), np.float32),
            "reward": np.zeros(n, np.float32),
            "terminated": np.zeros(n, np.bool_),
            "truncated": np.zeros(n, np.bool_),
            "final_observation": np.zeros((n, size), np.float32),
            "features": np.zeros((n, 5), np.float32),
            "reset_features": np.zeros((n, 5), np.float32),
            "contact": np.zeros((n, 2), np.bool_),
            "forward_velocity": np.zeros(n, np.float32),
            "ground_force": np.zeros((n, 2), np.float32),
            "hip_torque": np.zeros((n, 2), np.float32),
            **{name: np.zeros(n, np.float32) for name in (*POWERS, *LEG_MOTOR_POWERS)},
            "diverged": np.zeros(n, np.bool_),
        }

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.arrays[name]

    def step(self, actions: NDArray[np.float32] | None = None) -> None:
        n = self.batch.num_worlds
        buffers = _core.Buffers(self.batch, self.arrays)
        self.batch.step(np.zeros((n, self.batch.action_size), np.float32) if actions is None else actions, buffers)

    def trunk(self) -> NDArray[np.float64]:
        """x, y, angle, vx, vy, rate of world 0; x in the world."""
        state = self.batch.save()[0]
        trunk = state[TRUNK].copy()
        trunk[0] += state[19]
        return trunk

    def feet(self) -> NDArray[np.float64]:
        """The same six numbers of the left and the right foot of world 0."""
        state = self.batch.save()[0]
        first = int(state[18])
        feet = np.array([state[FEET[first]], state[FEET[1 - first]]])
        feet[:, 0] += state[19]
        return feet


def run(parameters: _core.Parameters, start: _core.Pose, substeps: int) -> tuple[NDArray[np.float64], ...]:
    """Trunk (substeps + 1, 6) and feet (substeps + 1, 2, 6) of one world after each substep, without action."""
    worlds = Worlds(parameters)
    worlds.batch.place(0, start)
    trunk, feet = [worlds.trunk()], [worlds.feet()]
    for _ in range(substeps):
        worlds.step()
        trunk.append(worlds.trunk())
        feet.append(worlds.feet())
    return np.array(trunk), np.array(feet)
