"""Poses of the planar humanoid that follow a reference: where episodes may start (Peng et al. 2018, section 6.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.model import body_ids
from romgrl.humanoid.planar_observer import LEFT_ANKLE, PELVIS_HEIGHT, RIGHT_ANKLE
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.start_states import Commanding, lowest_points, mirrored_at_random, within_ranges

Array = NDArray[np.float64]

STRAIGHT = 0.995
"""A leg is stretched to this share of its length at most: beyond, the knee's speed has no bound."""
LARGEST_JOINT_SPEED = 15.0
"""Joint speeds are cut to this, rad/s; running humans reach about 12 in the knee."""
SWING, ELBOW = 0.7, -1.2
"""Shoulder angle as a share of the hip's, against it, and the elbow's angle, rad."""


@dataclass(frozen=True)
class ReferenceStates:
    """Poses and velocities at random times of a reference, `dt` s between its steps.

    Pelvis and ankles lie where the reference has them, and joint speeds are central differences of the angles. The
    trunk is upright, the soles are level, the arms swing against the legs. Raises ValueError where no episode holds
    four steps.
    """

    model: mujoco.MjModel
    features: NDArray[np.float32]
    """(N, 5) m."""
    episode: NDArray[np.int32]
    """(N,)."""
    dt: float

    def __post_init__(self) -> None:
        if len(self.middle) == 0:
            raise ValueError("no episode of the reference holds four steps")

    @cached_property
    def data(self) -> mujoco.MjData:
        """Where positions are looked at."""
        return mujoco.MjData(self.model)

    @cached_property
    def middle(self) -> NDArray[np.int64]:
        """Steps that have one before and two behind them in their episode."""
        return np.flatnonzero(self.episode[3:] == self.episode[:-3]) + 1

    def draw(self, generator: np.random.Generator, count: int, commands: Commanding = None) -> tuple[Array, Array]:
        """Times between two steps, too: positions are interpolated."""
        rows, between = self.drawn_steps(generator, count, commands), generator.random((count, 1))

        def at(shift: int) -> Array:
            before, after = (self.features[rows + shift + step].astype(float) for step in (0, 1))
            return follow(self.model, before + between * (after - before))

        before, qpos, after = at(-1), at(0), at(1)
        qvel = (after - before) / (2 * self.dt)
        qvel[:, 3:] = np.clip(qvel[:, 3:], -LARGEST_JOINT_SPEED, LARGEST_JOINT_SPEED)
        qpos[:, 1] += np.maximum(0.0, -lowest_points(self.model, self.data, qpos))
        return mirrored_at_random(self.model, generator, qpos, qvel)

    def drawn_steps(self, generator: np.random.Generator, count: int, commands: Commanding) -> NDArray[np.int64]:
        """Which of `middle` (count,), whatever is asked."""
        return generator.choice(self.middle, count)


def follow(model: mujoco.MjModel, features: Array) -> Array:
    """Positions qpos (N, nq) with the pelvis and the ankles where `features` (N, 5) has them, as far as legs reach."""
    skeleton, rest = skeleton_of(model), standing(model)
    column, pelvis, left, right = skeleton.column, rest[skeleton.root], skeleton.left, skeleton.right
    qpos = np.zeros((len(features), model.nq))
    qpos[:, 1] = features[:, PELVIS_HEIGHT] - pelvis[1]
    for side, other, columns in ((left, right, LEFT_ANKLE), (right, left, RIGHT_ANKLE)):
        hip, knee, ankle = rest[side.hip], rest[side.knee], rest[side.ankle]
        target = features[:, columns] - (hip - pelvis)
        angles = leg_angles(target, thigh=knee - hip, shank=ankle - knee)
        qpos[:, [column[side.hip], column[side.knee]]] = angles
        qpos[:, column[side.ankle]] = -angles.sum(1)
        if other.shoulder is not None:
            qpos[:, column[other.shoulder]] = SWING * angles[:, 0]
        if other.elbow is not None:
            qpos[:, column[other.elbow]] = ELBOW
    qpos[:, 3:] = within_ranges(model, qpos[:, 3:])
    return qpos


@lru_cache(maxsize=8)
def standing(model: mujoco.MjModel) -> dict[str, Array]:
    """Where each body of the skeleton is with all joints at zero, (2,) forward and up, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    names = skeleton_of(model).bodies
    return {name: data.xpos[body][[0, 2]] for name, body in zip(names, body_ids(model), strict=True)}


def leg_angles(target: Array, *, thigh: Array, shank: Array) -> Array:
    """Hip and knee angles (N, 2), rad, that bring the ankle to `target` (N, 2) from the hip, the knee in front.

    thigh, shank: from hip to knee and from knee to ankle at rest, (2,) forward and up, m. The law of cosines gives the
    angle between the two; a target out of reach is drawn nearer.
    """
    a, b = np.linalg.norm(thigh), np.linalg.norm(shank)
    distance = np.clip(np.linalg.norm(target, axis=1), abs(a - b) + 0.01, STRAIGHT * (a + b))
    bend = np.arccos((distance**2 - a**2 - b**2) / (2 * a * b))
    above = hanging(target) - np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
    hip = above - hanging(thigh)
    return np.stack([hip, above + bend - hanging(shank) - hip], axis=1)


def hanging(line: Array) -> Array:
    """Angle (...) of a line (..., 2) with straight down, rad, backward positive as the hinges turn."""
    angle: Array = np.arctan2(-line[..., 0], -line[..., 1])
    return angle
