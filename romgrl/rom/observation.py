"""Observation layout of the spring-leg model and its left-right mirror image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Mirror = tuple[NDArray[np.int64], NDArray[np.float32]]

# Lengths are in leg lengths L0, speeds in sqrt(g L0), rates in sqrt(g / L0), loads in body weights, angles in rad;
# pitch and hip angle are positive forward.
OBSERVATION_NAMES: tuple[str, ...] = (
    "distance_since_touchdown",
    "height",
    "forward_velocity",
    "vertical_velocity",
    "pitch",
    "pitch_rate",
    "left_leg_strain",
    "right_leg_strain",
    "left_extension_rate",
    "right_extension_rate",
    "left_hip_angle",
    "right_hip_angle",
    "left_hip_rate",
    "right_hip_rate",
    "left_load",
    "right_load",
    "left_previous_action",
    "right_previous_action",
    "target_speed",
    "last_touchdown_side",
)
PAPER_COLUMNS: tuple[int, ...] = (0, 1, 2, 3, 6, 7, 8, 9, 10, 11, 12, 13, 18)


def _swap(names: tuple[str, ...]) -> Mirror:
    """Permutation that exchanges left and right, and the signs: mirrored = x[..., permutation] * sign."""
    exchanged = {"left": "right", "right": "left"}
    images = ["_".join([exchanged.get(name.split("_")[0], name.split("_")[0]), *name.split("_")[1:]]) for name in names]
    permutation = np.array([names.index(image) for image in images], dtype=np.int64)
    sign = np.array([-1.0 if name == "last_touchdown_side" else 1.0 for name in names], dtype=np.float32)
    return permutation, sign


MIRROR_OBSERVATION: Mirror = _swap(OBSERVATION_NAMES)
MIRROR_PAPER_OBSERVATION: Mirror = _swap(tuple(OBSERVATION_NAMES[column] for column in PAPER_COLUMNS))
MIRROR_ACTION: Mirror = _swap(("left_hip", "right_hip"))
