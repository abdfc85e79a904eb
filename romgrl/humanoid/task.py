"""Reward, terminations and gait features of the planar humanoid: functions on arrays, one row per humanoid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.skeleton import BODIES

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PELVIS, HEAD, NECK = (BODIES.index(name) for name in ("Pelvis", "Head", "Neck"))
ANKLES = tuple(BODIES.index(name) for name in ("L_Ankle", "R_Ankle"))

VELOCITY_LIMIT = 200.0
"""A joint speed (rad/s or m/s) that no body reaches: the simulation has diverged."""


def speed_reward(forward_velocity: Array, *, speed: float, alpha: float) -> Array:
    """exp(-alpha |v - speed|) (N,), paper equation for the task reward."""
    return np.exp(-alpha * np.abs(forward_velocity - speed))


def gait_features(position: Array) -> Array:
    """Pelvis height, then left and right ankle relative to the pelvis, forward and up (N, 5), m, from (N, 24, 3)."""
    features = np.empty((len(position), 5))
    features[:, 0] = position[:, PELVIS, 2]
    for column, ankle in zip((1, 3), ANKLES, strict=True):
        features[:, column : column + 2] = (position[:, ankle] - position[:, PELVIS])[:, (0, 2)]
    return features


def trunk_lean(position: Array) -> Array:
    """Angle of the line from pelvis to neck with the vertical (N,), rad, forward positive, from (N, 24, 3)."""
    line = position[:, NECK] - position[:, PELVIS]
    return np.arctan2(line[:, 0], line[:, 2])


def fallen(position: Array, *, pelvis_height: float, head_height: float, lean: float) -> Flags:
    """Pelvis or head too low (heights in m) or trunk leaning too far (rad), (N,), from (N, 24, 3)."""
    low = (position[:, PELVIS, 2] < pelvis_height) | (position[:, HEAD, 2] < head_height)
    return low | (np.abs(trunk_lean(position)) > lean)


def diverged(qpos: Array, qvel: Array, warnings: NDArray[np.int32]) -> Flags:
    """Numbers that are not finite, speeds that no body reaches, or physics warnings (N, kinds), (N,)."""
    finite = np.isfinite(qpos).all(axis=1) & np.isfinite(qvel).all(axis=1)
    return ~finite | (np.abs(qvel) > VELOCITY_LIMIT).any(axis=1) | (warnings > 0).any(axis=1)


def substeps(timestep: float, control_frequency: float) -> int:
    """Physics steps of `timestep` s in one control step; ValueError unless a whole number."""
    count = 1.0 / (control_frequency * timestep)
    if round(count) < 1 or abs(count - round(count)) > 1e-6:
        raise ValueError(f"control_frequency {control_frequency} is not a whole number of timesteps of {timestep} s")
    return round(count)


def check_arguments(*, reset_speed: Sequence[float], **positive: float) -> None:
    """ValueError for arguments of the environments that are out of range."""
    if len(reset_speed) != 2 or not 0 <= reset_speed[0] <= reset_speed[1]:
        raise ValueError(f"reset_speed must be a range of shares of the speed, not {reset_speed}")
    for name, value in positive.items():
        allowed = value >= 0 if name == "speed" else value > 0
        if not (np.isfinite(value) and allowed):
            raise ValueError(f"{name} must be {'at least 0' if name == 'speed' else 'positive'}, not {value}")
