"""Poses of the planar humanoid that follow a reference: where episodes may start (Peng et al. 2018, section 6.1)."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.model import body_ids, lowest_point
from romgrl.humanoid.planar_observer import LEFT_ANKLE, PELVIS_HEIGHT, RIGHT_ANKLE
from romgrl.humanoid.skeleton import skeleton_of
from romgrl.humanoid.start_states import ResetBank

Array = NDArray[np.float64]

STRAIGHT = 0.995
"""A leg is stretched to this share of its length at most: beyond, the knee's speed has no bound."""
LARGEST_JOINT_SPEED = 15.0
"""Joint speeds are cut to this, rad/s; running humans reach about 12 in the knee."""
SWING, ELBOW = 0.7, -1.2
"""Shoulder angle as a share of the hip's, against it, and the elbow's angle, rad."""


def reference_bank(
    model: mujoco.MjModel, features: NDArray[np.float32], episode: NDArray[np.int32], *, dt: float, size: int, seed: int
) -> ResetBank:
    """Poses and velocities at `size` random times of a reference, features (N, 5) in m and episode (N,), `dt` s apart.

    Pelvis and ankles lie where the reference has them, and joint speeds are central differences of the angles. The
    trunk is upright, the soles are level, the arms swing against the legs. Rows size/2 and later are mirror images.
    Raises ValueError where no episode holds three steps.
    """
    middle = np.flatnonzero(episode[2:] == episode[:-2]) + 1
    if len(middle) == 0:
        raise ValueError("no episode of the reference holds three steps")
    rows = np.random.default_rng(seed).choice(middle, size // 2)
    before, qpos, after = (follow(model, features[rows + shift].astype(float)) for shift in (-1, 0, 1))
    qvel = (after - before) / (2 * dt)
    qvel[:, 3:] = np.clip(qvel[:, 3:], -LARGEST_JOINT_SPEED, LARGEST_JOINT_SPEED)
    lift_out_of_floor(model, qpos)
    mirror = skeleton_of(model).mirror_joints()
    return ResetBank(np.concatenate([qpos, mirror.image(qpos)]), np.concatenate([qvel, mirror.image(qvel)]))


def follow(model: mujoco.MjModel, features: Array) -> Array:
    """Positions qpos (N, nq) with the pelvis and the ankles where `features` (N, 5) has them, as far as legs reach."""
    skeleton, data = skeleton_of(model), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    rest = {name: data.xpos[body][[0, 2]] for name, body in zip(skeleton.bodies, body_ids(model), strict=True)}
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
    low, high = model.jnt_range[3:].T
    qpos[:, 3:] = np.clip(qpos[:, 3:], low + 0.01, high - 0.01)
    return qpos


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


def lift_out_of_floor(model: mujoco.MjModel, qpos: Array) -> None:
    """Raise each row of `qpos` (N, nq) that is below the floor until it touches it."""
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        row[1] += max(0.0, -lowest_point(model, data))
