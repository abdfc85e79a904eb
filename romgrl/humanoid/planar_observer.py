"""Observations of planar humanoids from their joint angles, in C++."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid import _core
from romgrl.humanoid.model import body_ids
from romgrl.humanoid.skeleton import skeleton_of

GAIT_FEATURES = slice(0, 5)
LEFT_ANKLE, RIGHT_ANKLE = slice(1, 3), slice(3, 5)
PELVIS_HEIGHT, TRUNK_LEAN, HEAD_HEIGHT, FASTEST = 0, 5, 6, 7
SOLE_HEIGHT = slice(8, 10)
"""Columns of a posture."""


class PlanarObserver:
    """`observe` for many states at once and in the plane, where the orientation of a body is one angle.

    It equals `romgrl.humanoid.observation.observe` after a forward pass, but needs none.

    Args:
        model: planar model of `romgrl.humanoid.model.build`.
        columns: columns of the observation to return; None: all.
    """

    def __init__(self, model: mujoco.MjModel, columns: NDArray[np.int64] | None = None) -> None:
        kept = np.arange(skeleton_of(model).observation_size) if columns is None else columns
        self.columns = np.ascontiguousarray(kept, dtype=np.int32)
        self._bodies = planar_bodies(model)

    def __call__(
        self, qpos: NDArray[np.float64], qvel: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Observations (N, columns) and postures (N, 10) of states (N, nq) and (N, nv).

        Columns of a posture: the five gait features (pelvis height, then left and right ankle relative to the pelvis,
        forward and up), m; TRUNK_LEAN, the angle of the line from pelvis to neck with the vertical, rad, forward
        positive; HEAD_HEIGHT, m; FASTEST, the largest joint speed, rad/s or m/s, infinite for a state that is not
        finite; SOLE_HEIGHT, of the lowest point of the left and of the right foot above the ground, m.
        """
        observation = np.empty((len(qpos), len(self.columns)), np.float32)
        posture = np.empty((len(qpos), _core.POSTURE_SIZE))
        self._bodies.observe(qpos, qvel, self.columns, observation, posture)
        return observation, posture


def planar_bodies(model: mujoco.MjModel) -> _core.PlanarBodies:
    """Tree, offsets and axes of the model's bodies in its rest pose."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    skeleton, ids = skeleton_of(model), body_ids(model)
    order = {int(body): index for index, body in enumerate(ids)}
    parents = [order.get(int(model.body_parentid[body]), -1) for body in ids]
    last_joint = [model.body_jntadr[body] + model.body_jntnum[body] - 1 for body in ids]
    joints = [
        int(model.jnt_qposadr[joint]) if model.body_jntnum[body] else -1
        for body, joint in zip(ids, last_joint, strict=True)
    ]
    axes = data.xmat[ids].reshape(-1, 3, 3)
    return _core.PlanarBodies(
        parents=parents,
        joints=joints,
        offsets=(data.xpos[ids] - data.xpos[model.body_parentid[ids]]).tolist(),
        x_axes=axes[:, :, 0].tolist(),
        z_axes=axes[:, :, 2].tolist(),
        rest=model.qpos0.tolist(),
        left_ankle=skeleton.bodies.index(skeleton.left.ankle),
        right_ankle=skeleton.bodies.index(skeleton.right.ankle),
        neck=skeleton.bodies.index(skeleton.neck),
        head=skeleton.bodies.index(skeleton.head),
        soles=list(sole_points(model, data)),
    )


def sole_points(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[int, bool, list[float], float]]:
    """What the feet stand on: index of the body, whether it is the left foot's, offset from the body at rest, radius.

    Of every geom of a foot that can touch something: the centre of a sphere, both ends of a capsule, the corners of
    what bounds any other.
    """
    skeleton, touching = skeleton_of(model), {*model.pair_geom1, *model.pair_geom2}
    sphere, capsule = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    for geom in range(model.ngeom):
        name = model.body(int(model.geom_bodyid[geom])).name
        side = next((side for side, bodies in enumerate(skeleton.feet) if name in bodies), None)
        if side is None or not (geom in touching or model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue
        kind, size = int(model.geom_type[geom]), model.geom_size[geom]
        radius = float(size[0]) if kind in (sphere, capsule) else 0.0
        ends = {sphere: [np.zeros(3)], capsule: [sign * size[1] * np.eye(3)[2] for sign in (-1, 1)]}.get(kind)
        centre, half = np.split(model.geom_aabb[geom], 2)
        corners = [centre + half * signs for signs in itertools.product((-1, 1), repeat=3)]
        origin = data.geom_xpos[geom] - data.xpos[model.geom_bodyid[geom]]
        for point in ends or corners:
            offset = origin + data.geom_xmat[geom].reshape(3, 3) @ point
            yield skeleton.bodies.index(name), side == 0, offset.tolist(), radius
