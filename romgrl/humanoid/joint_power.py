"""What the batch does not report: power of the joints and contact of the feet, from recorded states and controls."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.skeleton import skeleton_of


def replay(
    model: mujoco.MjModel, states: NDArray[np.floating], actions: NDArray[np.floating], substeps: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Repeat control steps one by one, each from its own recorded state, so that no error builds up.

    states (T, nq + nv) before each step, actions (T, A) in [-1, 1]. Returns power (T,) in W, sum over the joints of
    |torque x angular velocity|, mean over the substeps, and contact (T, 2): left and right foot touch the ground at
    the end, with what is welded to them.
    """
    data = mujoco.MjData(model)
    feet = [[model.body_weldid[model.body(name).id] for name in names] for names in skeleton_of(model).feet]
    power, contact = np.zeros(len(states)), np.zeros((len(states), 2), np.bool_)
    for step, (state, action) in enumerate(zip(states, actions, strict=True)):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq :]
        data.ctrl[:] = np.clip(action, -1.0, 1.0)
        for _ in range(substeps):
            mujoco.mj_step1(model, data)
            mujoco.mj_step2(model, data)
            power[step] += np.abs(data.qfrc_actuator * data.qvel).sum() / substeps
        touching = model.body_weldid[model.geom_bodyid[data.contact.geom]]
        for foot, bodies in enumerate(feet):
            contact[step, foot] = bool(((touching == 0).any(axis=1) & np.isin(touching, bodies).any(axis=1)).any())
    return power, contact
