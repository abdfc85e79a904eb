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
OBSERVATION_SIZE = 358
_PLANE_SAMPLES = 64
_CONSTANT = 1e-9


def observe(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """The observation (358,) of `data` after a forward pass, on the full and on the planar model."""
    first = model.body("Pelvis").id
    bodies = slice(first, first + NUM_BODIES)
    return assemble(
        data.xpos[None, bodies], data.xmat[None, bodies], data.cvel[None, bodies], data.subtree_com[None, first]
    )[0]


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
    angular = velocity[..., :3]
    linear = velocity[..., 3:] + np.cross(angular, position - centre[:, None])
    # The pelvis z axis faces forward when standing (SMPL base rotation), so it gives the heading.
    cosine, sine = axes[:, 0, 1, 0], axes[:, 0, 1, 1]
    norm = np.hypot(cosine, sine)
    upright = norm > 0
    cosine = np.where(upright, cosine, 1.0) / np.where(upright, norm, 1.0)
    sine = sine / np.where(upright, norm, 1.0)
    observation = np.empty((count, OBSERVATION_SIZE))
    observation[:, 0] = position[:, 0, 2]
    for vectors, start in (
        (position[:, 1:] - position[:, :1], 1),
        (axes, 70),
        (linear, 214),
        (angular, 286),
    ):
        flat = vectors.reshape(count, -1, 3)
        block = observation[:, start : start + 3 * flat.shape[1]].reshape(count, -1, 3)
        x, y = flat[..., 0], flat[..., 1]
        block[..., 0] = cosine[:, None] * x + sine[:, None] * y
        block[..., 1] = cosine[:, None] * y - sine[:, None] * x
        block[..., 2] = flat[..., 2]
        observation[:, start : start + 3 * flat.shape[1]] = block.reshape(count, -1)
    return observation


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
