"""Mid-stride starting states of the planar humanoid."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.model import lowest_point
from romgrl.humanoid.skeleton import skeleton_of

BANK_SIZE = 1024
POSE_NOISE = 0.05
"""Spread of every joint angle, rad."""
RATE_NOISE = 0.1
"""Spread of every joint speed, rad/s."""


@dataclass(frozen=True)
class ResetBank:
    """States where episodes may start, from `build_bank`, `reference_states.reference_bank` or `mixed` from both."""

    qpos: NDArray[np.float64]
    """(M, nq)."""
    qvel: NDArray[np.float64]
    """(M, nv); an environment adds the forward speed that it draws."""

    def draw(self, generator: np.random.Generator, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """qpos and qvel (count, nq and nv) of random entries."""
        rows = generator.integers(len(self.qpos), size=count)
        return self.qpos[rows], self.qvel[rows]

    def mixed(self, other: ResetBank, share: float) -> ResetBank:
        """As many entries as this one has, `share` of them from `other`, evenly spaced."""
        taken = round(share * len(self.qpos))
        theirs = np.linspace(0, len(other.qpos), taken, endpoint=False).astype(np.int64)
        own = np.linspace(0, len(self.qpos), len(self.qpos) - taken, endpoint=False).astype(np.int64)
        return ResetBank(
            np.concatenate([self.qpos[own], other.qpos[theirs]]), np.concatenate([self.qvel[own], other.qvel[theirs]])
        )


def build_bank(model: mujoco.MjModel, size: int = BANK_SIZE) -> ResetBank:
    """Poses with one thigh forward, the other back with the knee bent, trunk upright, lowest sole on the ground.

    They are the same every time, within the joint ranges. Rows size/2 and later are mirror images of those before, so
    either side leads with equal probability; the forward speed is left at 0.
    """
    generator, half = np.random.default_rng(0), size // 2
    skeleton = skeleton_of(model)
    column, left, right = skeleton.column, skeleton.left, skeleton.right
    qpos = np.zeros((half, model.nq))
    qpos[:, 3:] = generator.normal(0.0, POSE_NOISE, (half, model.nq - 3))
    stride = generator.uniform(0.25, 0.5, half)
    for name, angle in (
        (left.hip, -stride),
        (left.knee, 0.15 + generator.uniform(0.0, 0.3, half)),
        (right.hip, 0.5 * stride),
        (right.knee, generator.uniform(0.5, 1.2, half)),
        (left.shoulder, stride),
        (right.shoulder, -stride),
        (left.elbow, np.full(half, -1.2)),
        (right.elbow, np.full(half, -1.2)),
    ):
        if name is not None:
            qpos[:, column[name]] += angle
    qpos[:, column[left.ankle]] -= qpos[:, column[left.hip]] + qpos[:, column[left.knee]]
    qpos[:, [column[name] for name in skeleton.trunk]] *= 0.5
    low, high = model.jnt_range[3:].T
    qpos[:, 3:] = np.clip(qpos[:, 3:], low + 0.01, high - 0.01)
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        row[1] = -lowest_point(model, data)
    qvel = np.zeros((half, model.nv))
    qvel[:, 3:] = generator.normal(0.0, RATE_NOISE, (half, model.nv - 3))
    mirror = skeleton.mirror_joints()
    return ResetBank(np.concatenate([qpos, mirror.image(qpos)]), np.concatenate([qvel, mirror.image(qvel)]))
