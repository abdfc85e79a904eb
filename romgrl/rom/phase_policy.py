"""A controller with a clock for legs with motors: a few numbers that CMA-ES can find (`teacher=cmaes`).

The clock of a leg, c in cycles, starts at its touchdown; the leg that did not touch down last is ahead by what the
footfall of the gait says, half a cycle in a walk or a run. A loaded leg has a hip torque and a drive that follow c
between knots, and a share of the torque for what the speed is off; another one swings towards a hip angle,

    torque = stiffness (angle(c) + placement (v - v*) - hip angle) - damping * hip rate,

with a drive of its own. All these numbers are polynomials of what is asked of the world, where that has a range. The
controller sees what the observation holds and remembers nothing: the time since the last touchdown is a column of it.
Raibert 1986, Legged Robots That Balance, for the placement.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.footfall import FOOTFALLS
from romgrl.rom.gait_clocks import CLOCKS
from romgrl.rom.observation import MOTOR_OBSERVATION_NAMES

Array = NDArray[np.float64]

LANDING = 0.05
"""A leg that has just touched down counts as loaded for so many cycles."""
LATE = 0.25
"""The clock of the leg that landed last stops so many cycles after the other one should have landed."""
STIFFNESS, DAMPING = 1.5, 0.27
"""Shares of the largest torque per rad and per sqrt(g / L0): what exponents of 0 stand for."""
LEG_COLUMNS = ("load", "hip_angle", "hip_rate")
SIDES = np.array([[1.0], [-1.0]], np.float32)  # of the last touchdown, left and right
COLUMNS = {name: MOTOR_OBSERVATION_NAMES.index(name) for name in MOTOR_OBSERVATION_NAMES}


class Span(NamedTuple):
    """The range of a command: a column of the observation and its ends there. A term of the parameters goes with a
    power of the command, -1 to 1 over the range."""

    column: str
    low: float
    high: float
    power: int = 1


class PhasePolicy:
    """Observations (N, 29) float32 of `romgrl.rom.observation.MOTOR_OBSERVATION_NAMES` -> actions (N, 4) in [-1, 1].

    parameters: (P,) for all worlds, or (N, P): those of the gait's clock in the middle of all spans, then for each span
    what its term adds to them at its high end.
    """

    observation_names: Sequence[str] = MOTOR_OBSERVATION_NAMES

    def __init__(self, parameters: Array, gait: str = "run", spans: Sequence[Span] = ()) -> None:
        self.parameters = np.atleast_2d(np.asarray(parameters, float))
        self.gait, self.spans, self.clock = gait, tuple(spans), CLOCKS[gait]
        self._stance, self._swing = np.array(self.clock.stance_knots), np.array(self.clock.swing_knots)
        self._ends = np.cumsum([len(values) for _, values, _ in self.clock.parts])[:-1]
        phase = FOOTFALLS[gait].phase
        self._ahead = np.array([[phase], [(1.0 - phase) % 1.0]])  # of left and right leg, where the other landed last
        self._latest = max(phase, 1.0 - phase) + LATE
        self._asked: NDArray[np.float32] | None = None  # in the step before, and the parameters for it
        self._parts: dict[str, Array] = {}
        self._legs = [[COLUMNS[f"{side}_{name}"] for side in ("left", "right")] for name in LEG_COLUMNS]

    def parts_for(self, observation: NDArray[np.float32]) -> dict[str, Array]:
        """The parameters of the worlds (N or 1, k) by their part, for what is asked of them."""
        asked = observation[:, [COLUMNS[span.column] for span in self.spans]]
        if self._asked is None or not np.array_equal(asked, self._asked):  # it seldom changes from one step to the next
            self._asked, self._parts = asked, self._parts_at(asked)
        return self._parts

    def _parts_at(self, asked: NDArray[np.float32]) -> dict[str, Array]:
        """As `parts_for`, for the columns of the spans (N, S)."""
        size = len(self.clock.mean)
        own = self.parameters[:, :size]
        for place, (span, column) in enumerate(zip(self.spans, asked.T, strict=True), 1):
            share = (2.0 * column - span.low - span.high) / (span.high - span.low)
            own = own + share[:, None] ** span.power * self.parameters[:, place * size : (place + 1) * size]
        names = (name for name, _, _ in self.clock.parts)
        return dict(zip(names, np.split(own, self._ends, axis=1), strict=True))

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        of, columns = self.parts_for(observation), COLUMNS
        rate = self.clock.rate * np.exp(of["log_rate"][:, 0])
        age = np.minimum(observation[:, columns["time_since_touchdown"]] * rate, self._latest)
        too_fast = observation[:, columns["forward_velocity"]] - observation[:, columns["target_speed"]]
        stiffness = STIFFNESS * np.exp(of["log_stiffness"][:, 0])
        damping = DAMPING * np.exp(of["log_damping"][:, 0])
        pushed, placed = of["push"][:, 0] * too_fast, of["placement"][:, 0] * too_fast
        load, angle, hip_rate = (observation[:, places].T for places in self._legs)  # (2, N)
        last = observation[:, columns["last_touchdown_side"]] * SIDES > 0
        clock = np.where(last, age, age + self._ahead)
        loaded = (load > 0) | (clock < LANDING)
        standing, swinging = knot_shares(clock, self._stance), knot_shares(clock, self._swing)
        aim = between(swinging, of["swing_angle"]) + placed
        swing = stiffness * (aim - angle) - damping * hip_rate
        stance = between(standing, of["stance_torque"]) + pushed
        action = np.empty((len(observation), 4), np.float32)
        action[:, :2] = np.where(loaded, stance, swing).T
        drives = between(standing, of["stance_drive"]), between(swinging, of["swing_drive"])
        action[:, 2:] = np.where(loaded, *drives).T
        return np.clip(action, -1.0, 1.0, out=action)


def knot_shares(clock: Array, knots: Array) -> list[Array]:
    """How much of the way between two knots has passed, for each pair of knots (K,): arrays of the shape of clock."""
    return [np.clip((clock - start) / (stop - start), 0.0, 1.0) for start, stop in pairwise(knots)]


def between(passed: Sequence[Array], values: Array) -> Array:
    """Linear between knots, the ends beyond them. passed: of `knot_shares` (2, N); values (N, K) or (1, K)."""
    risen = (share * (after - before) for share, (before, after) in zip(passed, pairwise(values.T), strict=True))
    return np.asarray(values[:, 0] + sum(risen))
