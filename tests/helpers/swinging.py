"""States of a humanoid that swings its legs at a known rate."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.helpers.synthetic_gait import DT


def swinging(model: Any, phase: Any, x: Any) -> Any:
    """States (T, nq + nv) at phases (T,) of a stride and places x (T,), m."""
    found = np.zeros((len(phase), model.nq + model.nv))
    swing = np.sin(2 * np.pi * phase)
    for joint, angle in (("L_Hip", -0.5 * swing), ("R_Hip", 0.5 * swing), ("L_Knee", 0.6 + 0.4 * swing)):
        names = [index for index in range(model.njnt) if model.joint(index).name.startswith(joint)]
        found[:, model.jnt_qposadr[names[0]]] = angle
    found[:, 0], found[:, 1] = x, 0.9
    return found


def running(model: Any, rate: float, steps: int) -> Any:
    """States (T, nq + nv) of one that moves forward at 4 m/s."""
    time = DT * np.arange(steps)
    return swinging(model, rate * time, 4.0 * time)
