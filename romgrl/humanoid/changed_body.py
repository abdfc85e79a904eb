"""The same humanoid, heavier or lighter, on rougher or smoother ground."""

from __future__ import annotations

import copy

import mujoco


def scaled(model: mujoco.MjModel, *, mass: float = 1.0, friction: float = 1.0) -> mujoco.MjModel:
    """A copy with every mass and inertia times `mass`, every sliding friction coefficient times `friction`.

    Lengths, servos and torque limits stay. MuJoCo takes the larger coefficient of two shapes, so all are scaled.
    """
    changed = copy.copy(model)
    changed.body_mass *= mass
    changed.body_inertia *= mass
    changed.geom_friction[:, 0] *= friction
    changed.pair_friction[:, :2] *= friction
    mujoco.mj_setConst(changed, mujoco.MjData(changed))
    return changed
