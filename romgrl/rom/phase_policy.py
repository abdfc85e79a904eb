"""A controller with a clock for legs with motors: twenty numbers that CMA-ES can find (`teacher=cmaes`).

The clock of a leg, c in cycles, starts at its touchdown; the leg that did not touch down last is half a cycle ahead. A
loaded leg has a hip torque and a drive that follow c between knots; another one swings towards a hip angle that does,

    torque = stiffness (angle(c) + placement (v - v*) - hip angle) - damping * hip rate,

with a drive of its own. It sees what the observation holds and remembers nothing: the time since the last touchdown is
a column of it. Raibert 1986, Legged Robots That Balance, for the placement.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from romgrl.rom.observation import MOTOR_OBSERVATION_NAMES

Array = NDArray[np.float64]

STANCE_KNOTS = np.array([0.0, 0.15, 0.3, 0.5])
SWING_KNOTS = np.array([0.25, 0.5, 0.75, 1.0])
LANDING = 0.05
"""A leg that has just touched down counts as loaded for so many cycles."""
LATEST = 0.75
"""The clock stops there where the other leg does not touch down."""
RATE, STIFFNESS, DAMPING = 0.445, 1.5, 0.27
"""Cycles per sqrt(L0 / g); shares of the largest torque per rad and per sqrt(g / L0): what exponents of 0 stand for."""
START: tuple[tuple[str, tuple[float, ...], float], ...] = (
    ("log_rate", (0.0,), 0.2),
    ("stance_torque", (-0.3, -0.3, -0.3, 0.0), 0.4),
    ("stance_drive", (0.2, 0.6, 0.6, 0.3), 0.4),
    ("swing_angle", (-0.2, 0.2, 0.4, 0.35), 0.15),
    ("swing_drive", (-0.5, -0.8, 0.3, 0.5), 0.4),
    ("log_stiffness", (0.0,), 0.4),
    ("log_damping", (0.0,), 0.4),
    ("placement", (0.1,), 0.07),
)
"""Name, first value and first deviation of each part; angles in rad, the rest in shares of what the motors can."""
MEAN = np.array([value for _, values, _ in START for value in values])
DEVIATION = np.array([deviation for _, values, deviation in START for _ in values])


class PhasePolicy:
    """Observations (N, 28) float32 of `romgrl.rom.observation.MOTOR_OBSERVATION_NAMES` -> actions (N, 4) in [-1, 1].

    parameters: (P,) for all worlds, or (N, P); in the order of START.
    """

    observation_names: Sequence[str] = MOTOR_OBSERVATION_NAMES

    def __init__(self, parameters: Array) -> None:
        self.parameters = np.atleast_2d(np.asarray(parameters, float))
        ends = np.cumsum([len(values) for _, values, _ in START])
        parts = np.split(self.parameters, ends[:-1], axis=1)
        self._of = {name: part for (name, _, _), part in zip(START, parts, strict=True)}
        column = MOTOR_OBSERVATION_NAMES.index
        self._age, self._side = column("time_since_touchdown"), column("last_touchdown_side")
        self._speed, self._target = column("forward_velocity"), column("target_speed")
        self._legs = [
            (column(f"{side}_load"), column(f"{side}_hip_angle"), column(f"{side}_hip_rate"))
            for side in ("left", "right")
        ]

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        of = self._of
        rate = RATE * np.exp(of["log_rate"][:, 0])
        age = np.minimum(observation[:, self._age] * rate, LATEST)
        too_fast = observation[:, self._speed] - observation[:, self._target]
        stiffness = STIFFNESS * np.exp(of["log_stiffness"][:, 0])
        damping = DAMPING * np.exp(of["log_damping"][:, 0])
        action = np.empty((len(observation), 4), np.float32)
        for leg, (load, angle, hip_rate) in enumerate(self._legs):
            last = observation[:, self._side] * (1 - 2 * leg) > 0
            clock = np.where(last, age, age + 0.5)
            loaded = (observation[:, load] > 0) | (clock < LANDING)
            aim = between(clock, SWING_KNOTS, of["swing_angle"]) + of["placement"][:, 0] * too_fast
            swing = stiffness * (aim - observation[:, angle]) - damping * observation[:, hip_rate]
            action[:, leg] = np.where(loaded, between(clock, STANCE_KNOTS, of["stance_torque"]), swing)
            action[:, 2 + leg] = np.where(
                loaded, between(clock, STANCE_KNOTS, of["stance_drive"]), between(clock, SWING_KNOTS, of["swing_drive"])
            )
        return np.clip(action, -1.0, 1.0, out=action)


def between(clock: Array, knots: Array, values: Array) -> Array:
    """Linear between knots (K,), the ends beyond them. clock (N,), values (N, K) or (1, K) -> (N,)."""
    passed = np.clip((clock[:, None] - knots[:-1]) / np.diff(knots), 0.0, 1.0)
    return np.asarray(values[:, 0] + (passed * np.diff(values, axis=1)).sum(axis=1))
