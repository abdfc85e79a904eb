"""HumEnv's 358 numbers of a humanoid with SMPL's 24 bodies, for one state or for many.

Layout: pelvis height above the ground (1); positions of the other 23 bodies relative to the pelvis (69); orientation of
all 24 as the images of their local x and z axes (144); linear velocity of their origins (72); angular velocity (72).
Everything is seen from the heading frame: the world turned about z so that x points where the pelvis faces, the
pelvis orientation being measured from SMPL's standing base rotation. Units: m, m/s, rad/s.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.skeleton import BODIES

NUM_BODIES = len(BODIES)
NUM_VECTORS = 119
"""Three-vectors of an observation: 23 positions, 48 axes, 24 linear and 24 angular velocities."""
OBSERVATION_SIZE = 1 + 3 * NUM_VECTORS
_PLANE_SAMPLES = 64
_CONSTANT = 1e-9


def observe(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """The observation (358,) of `data` after a forward pass, on the full and on the planar model."""
    first = model.body("Pelvis").id
    bodies = slice(first, first + NUM_BODIES)
    batch = assemble(
        data.xpos[None, bodies], data.xmat[None, bodies], data.cvel[None, bodies], data.subtree_com[None, first]
    )
    return batch.reshape(OBSERVATION_SIZE)


def assemble(
    position: NDArray[np.float64],
    rotation: NDArray[np.float64],
    velocity: NDArray[np.float64],
    centre: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Observations (N, 358) from MuJoCo's kinematics of the 24 bodies.

    Args:
        position: origins (N, 24, 3), MuJoCo's xpos.
        rotation: orientations (N, 24, 9) row by row, MuJoCo's xmat.
        velocity: angular velocity and linear velocity of the point at `centre` (N, 24, 6), MuJoCo's cvel.
        centre: centre of mass of the whole body (N, 3).
    """
    count = len(position)
    axes = rotation.reshape(count, NUM_BODIES, 3, 3)[..., (0, 2)].swapaxes(2, 3)
    vectors = np.empty((count, NUM_VECTORS, 3))
    vectors[:, :23] = position[:, 1:] - position[:, :1]
    vectors[:, 23:71] = axes.reshape(count, -1, 3)
    vectors[:, 71:95] = _velocity_of_origins(position, velocity, centre)
    vectors[:, 95:] = velocity[..., :3]
    cosine, sine = _heading(axes[:, 0, 1])
    observation = np.empty((count, OBSERVATION_SIZE))
    observation[:, 0] = position[:, 0, 2]
    turned = observation[:, 1:].reshape(count, NUM_VECTORS, 3)  # a view
    x, y = vectors[..., 0], vectors[..., 1]
    turned[..., 0] = cosine * x + sine * y
    turned[..., 1] = cosine * y - sine * x
    turned[..., 2] = vectors[..., 2]
    return observation


def _velocity_of_origins(
    position: NDArray[np.float64], velocity: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear velocity (N, 24, 3) of the body origins: v + omega x (p - c)."""
    wx, wy, wz = (velocity[..., axis] for axis in range(3))
    rx, ry, rz = (position[..., axis] - centre[:, None, axis] for axis in range(3))
    linear = velocity[..., 3:].copy()
    linear[..., 0] += wy * rz - wz * ry
    linear[..., 1] += wz * rx - wx * rz
    linear[..., 2] += wx * ry - wy * rx
    return linear


def _heading(facing: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cosine and sine (N, 1) of the heading, from the z axis (N, 3) of the pelvis, forward when standing."""
    norm = np.hypot(facing[:, 0], facing[:, 1])
    safe = np.where(norm > 0, norm, 1.0)
    cosine = np.where(norm > 0, facing[:, 0] / safe, 1.0)
    return cosine[:, None], (facing[:, 1] / safe)[:, None]


def varying_columns(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Columns of the observation that are not constant in the plane, from random states with a fixed seed."""
    generator = np.random.default_rng(0)
    data = mujoco.MjData(model)
    samples = np.empty((_PLANE_SAMPLES, OBSERVATION_SIZE))
    for sample in samples:
        data.qpos[:] = generator.uniform(-1.0, 1.0, model.nq)
        data.qvel[:] = generator.uniform(-1.0, 1.0, model.nv)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        sample[:] = observe(model, data)
    return np.flatnonzero(np.ptp(samples, axis=0) > _CONSTANT)
