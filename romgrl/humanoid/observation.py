"""HumEnv's numbers of a humanoid, 358 for SMPL's 24 bodies, for one state or for many.

Layout for B bodies: height of the root, the pelvis, above the ground (1); positions of the other bodies relative to it
(3 B - 3); orientation of all as the images of their local x and z axes (6 B); linear velocity of their origins (3 B);
angular velocity (3 B). Everything is seen from the heading frame: the world turned about z so that x points where the
pelvis faces, the pelvis orientation being measured from that of standing. Units: m, m/s, rad/s.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.gait.symmetry import Mirror, by_name
from romgrl.humanoid.model import body_ids
from romgrl.humanoid.skeleton import Skeleton, skeleton_of

_PLANE_SAMPLES = 64
_CONSTANT = 1e-9


def observe(model: mujoco.MjModel, data: mujoco.MjData, skeleton: Skeleton | None = None) -> NDArray[np.float64]:
    """The observation (O,) of `data` after a forward pass, on the full and on the planar model.

    O is the skeleton's `observation_size`, 358 for SMPL's. Bodies that the skeleton does not have are left out.

    skeleton: of the model's bodies; None: the one that it was built with, SMPL's for any other model.
    """
    skeleton = skeleton or skeleton_of(model)
    bodies = body_ids(model, skeleton)
    batch = assemble(
        data.xpos[None, bodies],
        data.xmat[None, bodies],
        data.cvel[None, bodies],
        data.subtree_com[None, bodies[0]],
        forward=skeleton.axes[0],
    )
    return batch.reshape(-1)


def observation_names(skeleton: Skeleton, commands: Sequence[str] = ()) -> tuple[str, ...]:
    """What each number of the observation is, such as Pelvis.height, L_Hip.axis_x.z and Head.angular_velocity.y.

    commands: names of further columns, after those of the body.
    """
    quantities = (
        (skeleton.bodies[1:], ("position",)),
        (skeleton.bodies, ("axis_x", "axis_z")),
        (skeleton.bodies, ("velocity",)),
        (skeleton.bodies, ("angular_velocity",)),
    )
    vectors = [f"{body}.{name}" for bodies, names in quantities for body in bodies for name in names]
    body = (f"{skeleton.root}.height", *(f"{vector}.{component}" for vector in vectors for component in "xyz"))
    return (*body, *commands)


def mirror_observation(skeleton: Skeleton, commands: Sequence[str] = ()) -> Mirror:
    """Mirror of the observation (O,) in the sagittal plane, which leaves further columns of `commands` as they are.

    With M = diag(1, -1, 1) in the world and S in the body frames, which negates the lateral axis (SMPL's x), the
    mirrored rotation is M R S: the column of the lateral axis becomes -M R e, another M R e. Angular velocity is a
    pseudovector.
    """
    negated_whole = (f"axis_{'xyz'[skeleton.axes[1]]}", "angular_velocity")

    def other_side(name: str) -> str:
        if name in commands:
            return name
        body, _, rest = name.partition(".")
        return f"{skeleton.other_side(body)}.{rest}"

    names = observation_names(skeleton)
    lateral = {name for name in names if name.endswith(".y")}
    whole = {name for name in names if name.split(".")[1] in negated_whole}
    return by_name((*names, *commands), other_side, negated=lateral ^ whole)


def assemble(
    position: NDArray[np.float64],
    rotation: NDArray[np.float64],
    velocity: NDArray[np.float64],
    centre: NDArray[np.float64],
    *,
    forward: int,
) -> NDArray[np.float64]:
    """Observations (N, O) from MuJoCo's kinematics of the B bodies, the root first.

    Args:
        position: origins (N, B, 3), MuJoCo's xpos.
        rotation: orientations (N, B, 9) row by row, MuJoCo's xmat.
        velocity: angular velocity and linear velocity of the point at `centre` (N, B, 6), MuJoCo's cvel.
        centre: centre of mass of the whole body (N, 3).
        forward: axis of the root, 0 to 2, that points forward when standing.
    """
    count, bodies = position.shape[:2]
    frames = rotation.reshape(count, bodies, 3, 3)
    parts = (
        position[:, 1:] - position[:, :1],
        frames[..., (0, 2)].swapaxes(2, 3).reshape(count, 2 * bodies, 3),
        _velocity_of_origins(position, velocity, centre),
        velocity[..., :3],
    )
    vectors = np.concatenate(parts, axis=1)
    cosine, sine = _heading(frames[:, 0, :, forward])
    observation = np.empty((count, 1 + 3 * vectors.shape[1]))
    observation[:, 0] = position[:, 0, 2]
    turned = observation[:, 1:].reshape(vectors.shape)  # a view
    x, y = vectors[..., 0], vectors[..., 1]
    turned[..., 0] = cosine * x + sine * y
    turned[..., 1] = cosine * y - sine * x
    turned[..., 2] = vectors[..., 2]
    return observation


def _velocity_of_origins(
    position: NDArray[np.float64], velocity: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear velocity (N, B, 3) of the body origins: v + omega x (p - c)."""
    wx, wy, wz = (velocity[..., axis] for axis in range(3))
    rx, ry, rz = (position[..., axis] - centre[:, None, axis] for axis in range(3))
    linear = velocity[..., 3:].copy()
    linear[..., 0] += wy * rz - wz * ry
    linear[..., 1] += wz * rx - wx * rz
    linear[..., 2] += wx * ry - wy * rx
    return linear


def _heading(facing: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cosine and sine (N, 1) of the heading, from where the pelvis faces (N, 3)."""
    norm = np.hypot(facing[:, 0], facing[:, 1])
    safe = np.where(norm > 0, norm, 1.0)
    cosine = np.where(norm > 0, facing[:, 0] / safe, 1.0)
    return cosine[:, None], (facing[:, 1] / safe)[:, None]


def varying_columns(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Columns of the observation that are not constant in the plane, from random states with a fixed seed."""
    generator = np.random.default_rng(0)
    data = mujoco.MjData(model)
    samples = np.empty((_PLANE_SAMPLES, skeleton_of(model).observation_size))
    for sample in samples:
        data.qpos[:] = generator.uniform(-1.0, 1.0, model.nq)
        data.qvel[:] = generator.uniform(-1.0, 1.0, model.nv)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        sample[:] = observe(model, data)
    return np.flatnonzero(np.ptp(samples, axis=0) > _CONSTANT)
