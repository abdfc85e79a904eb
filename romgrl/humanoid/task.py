"""Reward and terminations of the planar humanoid: functions on arrays, one row per humanoid.

A posture (N, POSTURE_SIZE) is what `romgrl.humanoid.planar_observer.PlanarObserver` returns beside the observation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from romgrl.humanoid.model import CONTROL_FREQUENCY, dimensions
from romgrl.humanoid.planar_observer import FASTEST, HEAD_HEIGHT, PELVIS_HEIGHT, TRUNK_LEAN

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Speeds = NDArray[np.floating[Any]]

UPRIGHT, HIGH = 0.3, 0.1
"""Lean of the trunk (rad), and share of the standing height by which the pelvis is off, that leave 1/e of the reward
for the posture."""
SLOWEST = 0.5
"""Below this target speed, m/s, errors count as they do there: a walker that is to stand may sway."""
VELOCITY_LIMIT = 200.0
"""A joint speed (rad/s or m/s) that no body reaches: the simulation has diverged."""


def speed_reward(forward_velocity: Speeds, *, speed: float | Array, alpha: float | Array) -> Array:
    """exp(-alpha |v - speed|) (N,), the paper's task reward; one speed and alpha for all, or (N,)."""
    rewarded: Array = np.exp(-alpha * np.abs(forward_velocity - speed))
    return rewarded


def relative_sensitivity(speed: float | Array) -> Array:
    """Alpha, s/m, with which a relative error counts the same at all speeds, m/s: 1 at 4 m/s, as in the paper."""
    return np.asarray(4.0 / np.maximum(speed, SLOWEST))


def sensitivity(alpha: float | None, speed: float | Array) -> float | Array:
    """Alpha of `speed_reward`, s/m: the one that is given, or for None `relative_sensitivity` of the speed, m/s."""
    return relative_sensitivity(speed) if alpha is None else alpha


def posture_reward(posture: Array, *, standing_height: float) -> Array:
    """exp(-(lean / 0.3 rad)^2 - ((pelvis height / standing height - 1) / 0.1)^2) (N,): upright and high."""
    lean, height = posture[:, TRUNK_LEAN] / UPRIGHT, (posture[:, PELVIS_HEIGHT] / standing_height - 1.0) / HIGH
    rewarded: Array = np.exp(-np.square(lean) - np.square(height))
    return rewarded


def fallen(posture: Array, *, pelvis_height: float, head_height: float, lean: float) -> Flags:
    """Pelvis or head too low (heights in m) or trunk leaning too far (rad), (N,)."""
    low = (posture[:, PELVIS_HEIGHT] < pelvis_height) | (posture[:, HEAD_HEIGHT] < head_height)
    return low | (np.abs(posture[:, TRUNK_LEAN]) > lean)


def diverged(posture: Array, warnings: NDArray[np.int32]) -> Flags:
    """Numbers that are not finite, speeds that no body reaches, or physics warnings (N, kinds), (N,).

    MuJoCo puts a simulation whose numbers are bad back to its default state, so the warning is what tells.
    """
    warned: Flags = np.any(warnings, axis=1)
    return warned | (posture[:, FASTEST] > VELOCITY_LIMIT)


class SpeedSettings(TypedDict, total=False):
    """The arguments that both environments share; their defaults are those of `SpeedTask.of`."""

    speed: float
    """Target speed, m/s; humanoids with commands have speeds of their own instead."""
    alpha: float | None
    """Sensitivity of the reward exp(-alpha |v - speed|), s/m; v is the mean forward velocity of the pelvis over the
    control step. None: `relative_sensitivity` of the target speed."""
    posture_weight: float
    """Share w of `posture_reward` in the reward, (1 - w) of which is for the speed."""
    episode_steps: int
    """An episode is truncated after this many control steps."""
    reset_speed: Sequence[float]
    """Range of the forward speed at reset, share of the target speed."""
    fall_pelvis_height: float
    """An episode ends when the pelvis is below this share of its standing height."""
    fall_head_height: float
    """The same for the head."""
    fall_trunk_lean: float
    """An episode ends beyond this lean of the pelvis-neck line, rad."""
    control_frequency: float
    """Control steps per second; a whole number of the model's timesteps."""


@dataclass(frozen=True)
class SpeedTask:
    """Running at a speed: the numbers of the task for one model, in SI units."""

    speed: float
    """Of humanoids without commands."""
    alpha: float | None
    """None: `relative_sensitivity` of the target speed."""
    posture_weight: float
    standing_height: float
    """Of the pelvis, m."""
    episode_steps: int
    reset_speed: tuple[float, float]
    """Range of the forward speed at reset, share of the target speed."""
    pelvis_height: float
    head_height: float
    lean: float
    """Limits of `fallen`."""
    substeps: int
    control_step: float
    """Duration of a control step, s."""

    @classmethod
    def of(
        cls,
        model: mujoco.MjModel,
        *,
        speed: float = 4.0,
        alpha: float | None = 1.0,
        posture_weight: float = 0.0,
        episode_steps: int = 300,
        reset_speed: Sequence[float] = (0.0, 1.0),
        fall_pelvis_height: float = 0.65,
        fall_head_height: float = 0.62,
        fall_trunk_lean: float = 0.8,
        control_frequency: float = CONTROL_FREQUENCY,
    ) -> SpeedTask:
        """The task of `SpeedSettings` for this model; ValueError for arguments out of range."""
        if len(reset_speed) != 2 or not 0 <= reset_speed[0] <= reset_speed[1] < np.inf:
            raise ValueError(f"reset_speed must be a range of shares of the speed, not {reset_speed}")
        _check_at_least_zero(speed=speed, fall_pelvis_height=fall_pelvis_height, fall_head_height=fall_head_height)
        _check_positive(
            alpha=1.0 if alpha is None else alpha, fall_trunk_lean=fall_trunk_lean, control_frequency=control_frequency
        )
        if not 0 <= posture_weight <= 1:
            raise ValueError(f"posture_weight must be between 0 and 1, not {posture_weight}")
        check_counts(episode_steps=episode_steps)
        size, timestep = dimensions(model), model.opt.timestep
        substeps = round(1.0 / (control_frequency * timestep))
        if substeps < 1 or abs(substeps * timestep * control_frequency - 1.0) > 1e-6:
            raise ValueError(f"control_frequency {control_frequency} is not a whole number of {timestep} s steps")
        return cls(
            speed=speed,
            alpha=alpha,
            posture_weight=posture_weight,
            standing_height=size.pelvis_height,
            episode_steps=episode_steps,
            reset_speed=(reset_speed[0], reset_speed[1]),
            pelvis_height=fall_pelvis_height * size.pelvis_height,
            head_height=fall_head_height * size.head_height,
            lean=fall_trunk_lean,
            substeps=substeps,
            control_step=substeps * timestep,
        )

    def reward(self, forward_velocity: Array, posture: Array, speeds: Array | None = None) -> Array:
        """(1 - w) `speed_reward` + w `posture_reward`, (N,), at this task's speed or at those of commands (N,)."""
        asked = self.speed if speeds is None else speeds
        rewarded = speed_reward(forward_velocity, speed=asked, alpha=sensitivity(self.alpha, asked))
        upright = posture_reward(posture, standing_height=self.standing_height)
        return (1.0 - self.posture_weight) * rewarded + self.posture_weight * upright

    def fallen(self, posture: Array) -> Flags:
        """`fallen` with this task's limits, (N,)."""
        return fallen(posture, pelvis_height=self.pelvis_height, head_height=self.head_height, lean=self.lean)

    def draw_speed(self, generator: np.random.Generator, count: int, speeds: Array | None = None) -> Array:
        """Forward speeds at reset (count,), m/s: shares of this task's speed, or of those of commands (count,)."""
        asked, (low, high) = self.speed if speeds is None else speeds, self.reset_speed
        return generator.uniform(low * asked, high * asked, size=count)


def controls(model: mujoco.MjModel, actions: ArrayLike) -> Array:
    """Controls (..., A) of actions in [-1, 1], the ends of the actuators' ranges; larger actions are clipped."""
    low, high = model.actuator_ctrlrange.T
    scaled: Array = low + 0.5 * (high - low) * (np.clip(actions, -1.0, 1.0) + 1.0)
    return scaled


def check_actions(actions: ArrayLike, shape: tuple[int, ...]) -> None:
    """ValueError unless the actions are finite numbers of that shape."""
    if np.shape(actions) != shape:
        raise ValueError(f"actions must have shape {shape}, not {np.shape(actions)}")
    if not np.isfinite(actions).all():
        raise ValueError("actions must be finite")


def check_counts(**counts: int) -> None:
    """ValueError unless every count is at least 1."""
    for name, value in counts.items():
        if value < 1:
            raise ValueError(f"{name} must be at least 1, not {value}")


def _check_positive(**numbers: float) -> None:
    for name, value in numbers.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive, not {value}")


def _check_at_least_zero(**numbers: float) -> None:
    for name, value in numbers.items():
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name} must be at least 0, not {value}")
