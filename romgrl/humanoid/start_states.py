"""Where episodes of the planar humanoid begin: drawn anew at every reset, either side leading equally often."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.model import lowest_point
from romgrl.humanoid.skeleton import skeleton_of

Array = NDArray[np.float64]
Commanding = NDArray[np.float32] | None

POSE_NOISE = 0.05
"""Spread of every joint angle, rad."""
RATE_NOISE = 0.1
"""Spread of every joint speed, rad/s."""


class StartStates(Protocol):
    """Where episodes may begin."""

    def draw(self, generator: np.random.Generator, count: int, commands: Commanding = None) -> tuple[Array, Array]:
        """qpos and qvel (count, nq and nv); an environment adds the forward speed that it draws.

        commands: of these episodes (count, 2 + G), as `romgrl.humanoid.commands` has them; None: there are none.
        """


@dataclass(frozen=True)
class StrideStates:
    """Mid-stride: one thigh forward, the other back with the knee bent, trunk upright, lowest sole on the ground."""

    model: mujoco.MjModel

    @cached_property
    def data(self) -> mujoco.MjData:
        """Where positions are looked at."""
        return mujoco.MjData(self.model)

    def draw(self, generator: np.random.Generator, count: int, commands: Commanding = None) -> tuple[Array, Array]:
        """Within the joint ranges; the forward speed is left at 0."""
        model, skeleton = self.model, skeleton_of(self.model)
        column, left, right = skeleton.column, skeleton.left, skeleton.right
        qpos, qvel = np.zeros((count, model.nq)), np.zeros((count, model.nv))
        qpos[:, 3:] = generator.normal(0.0, POSE_NOISE, (count, model.nq - 3))
        qvel[:, 3:] = generator.normal(0.0, RATE_NOISE, (count, model.nv - 3))
        stride = generator.uniform(0.25, 0.5, count)
        for name, angle in (
            (left.hip, -stride),
            (left.knee, 0.15 + generator.uniform(0.0, 0.3, count)),
            (right.hip, 0.5 * stride),
            (right.knee, generator.uniform(0.5, 1.2, count)),
            (left.shoulder, stride),
            (right.shoulder, -stride),
            (left.elbow, np.full(count, -1.2)),
            (right.elbow, np.full(count, -1.2)),
        ):
            if name is not None:
                qpos[:, column[name]] += angle
        qpos[:, column[left.ankle]] -= qpos[:, column[left.hip]] + qpos[:, column[left.knee]]
        qpos[:, [column[name] for name in skeleton.trunk]] *= 0.5
        qpos[:, 3:] = within_ranges(model, qpos[:, 3:])
        qpos[:, 1] -= lowest_points(model, self.data, qpos)
        return mirrored_at_random(model, generator, qpos, qvel)


@dataclass(frozen=True)
class MixedStates:
    """States of `second` with probability `share`, of `first` otherwise."""

    first: StartStates
    second: StartStates
    share: float

    def draw(self, generator: np.random.Generator, count: int, commands: Commanding = None) -> tuple[Array, Array]:
        """Each row by itself."""
        theirs = generator.random(count) < self.share
        qpos, qvel = self.first.draw(generator, count, commands)
        asked = None if commands is None else commands[theirs]
        qpos[theirs], qvel[theirs] = self.second.draw(generator, int(theirs.sum()), asked)
        return qpos, qvel


def within_ranges(model: mujoco.MjModel, angles: Array) -> Array:
    """Joint angles (N, nq - 3), rad, clipped to just inside their ranges."""
    low, high = model.jnt_range[3:].T
    clipped: Array = np.clip(angles, low + 0.01, high - 0.01)
    return clipped


def lowest_points(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> Array:
    """Height (N,) of the lowest sole in positions (N, nq), m; `data` is overwritten."""
    heights = np.zeros(len(qpos))
    for row, position in enumerate(qpos):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        heights[row] = lowest_point(model, data)
    return heights


def mirrored_at_random(
    model: mujoco.MjModel, generator: np.random.Generator, qpos: Array, qvel: Array
) -> tuple[Array, Array]:
    """Each row as it is or as its mirror image, with equal probability."""
    mirror, flipped = skeleton_of(model).mirror_joints(), generator.random(len(qpos)) < 0.5
    qpos[flipped], qvel[flipped] = mirror.image(qpos[flipped]), mirror.image(qvel[flipped])
    return qpos, qvel
