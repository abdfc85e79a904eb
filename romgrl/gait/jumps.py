"""How high jumps are: free functions on features (E, T, 5) m, contact (E, T, 2) and valid (E, T)."""

from __future__ import annotations

import numpy as np

from romgrl.gait.features import BODY_Y, Bools, Floats, Gait
from romgrl.gait.load_metrics import whole_runs

JUMP_MEASURES = ("jumps", "jump_apex_m", "jump_apex_error_m")
"""Columns of gait.csv and library.csv of a gait that jumps."""


def describe_jumps(gait: Gait, *, asked: float, standing: float) -> dict[str, float]:
    """JUMP_MEASURES: whole jumps, their mean apex and their mean absolute distance from the one asked for, m.

    standing: height of the body on legs of their rest length, m, which an apex is measured from.
    """
    assert gait.contact is not None
    apexes = jump_apexes(gait.features, gait.contact, gait.valid) - standing
    if not len(apexes):
        return dict(zip(JUMP_MEASURES, (0.0, float("nan"), float("nan")), strict=True))
    return dict(
        zip(JUMP_MEASURES, (len(apexes), float(apexes.mean()), float(np.abs(apexes - asked).mean())), strict=True)
    )


def jump_apexes(features: Floats, contact: Bools, valid: Bools) -> Floats:
    """Highest body over each flight that begins and ends among the valid steps (jumps,), m.

    Heights are known once a control step: at 30 Hz a top is missed by g dt^2 / 8 = 1.4 mm at most.
    """
    apexes = []
    for heights, feet, mask in zip(features[..., BODY_Y], contact, valid, strict=True):
        height, flying = heights[mask], ~feet[mask].any(axis=1)
        apexes += [height[start:stop].max() for start, stop in whole_runs(flying)]
    return np.array(apexes)
