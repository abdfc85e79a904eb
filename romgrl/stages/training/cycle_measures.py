"""What controllers come to in a try of a search: sums over its steps, and what they amount to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import BODY_Y

Array = NDArray[np.float64]

SETTLED = 1 / 3
"""The share of a try before its speed counts; of a world that falls within it, the speed until then does."""
UNJUMPED = 1.0
"""Distance from the apex asked for of a world without a jump, m."""
SHORTEST_GAP = 0.1
"""Touchdowns of both feet within it, s, are one where the feet come down together."""


class Tries(NamedTuple):
    """What worlds came to, each (W,): share of the steps before a fall, mean speed once settled, m/s, how far the one
    of the second half of these steps is from it, m/s, deviation of the times between touchdowns over their mean, share
    of the steps with no foot on the ground, positive power in W, mean distance of the apexes of jumps from the one
    asked for, m."""

    upright: Array
    speed: Array
    drift: Array
    limp: Array
    flight: Array
    power: Array
    apex_error: Array


@dataclass
class TouchdownTimes:
    """The times between touchdowns of (N,) worlds, as sums: only one that follows another is counted.

    phase: of the right touchdown in the left stride, by which the times are made comparable; 0: both are one.
    """

    phase: float
    side: Array
    last: Array
    count: Array
    total: Array
    squares: Array

    @classmethod
    def of(cls, side: Array, phase: float) -> TouchdownTimes:
        """Before the first one."""
        return cls(phase, side.copy(), np.full(len(side), np.nan), *(np.zeros(len(side)) for _ in range(3)))

    def add(self, side: Array, time: Array, counted: NDArray[np.bool_]) -> None:
        """Take in a step: the side of the last touchdown and when it was, s."""
        if self.phase:
            new = counted & (side != self.side)
            usual = 2.0 * np.where(side > 0, 1.0 - self.phase, self.phase)
        else:
            new = counted & ~(time - self.last <= SHORTEST_GAP)  # true where there was none
            usual = np.ones(len(side))
        gap = np.where(new & np.isfinite(self.last), (time - self.last) / usual, 0.0)
        self.count += gap > 0
        self.total += gap
        self.squares += gap**2
        self.last[new] = time[new]
        self.side[:] = side

    def spread(self) -> Array:
        """Deviation over mean; 0.5 where there are not two."""
        count = np.maximum(self.count, 1)
        mean = self.total / count
        deviation = np.sqrt(np.maximum(self.squares / count - mean**2, 0.0))
        return np.where(self.count >= 2, deviation / np.maximum(mean, 1e-9), 0.5)


class ApexErrors:
    """How far the tops of (N,) worlds' flights are from the body height asked for, m, as sums of whole flights."""

    def __init__(self, asked: Array) -> None:
        self.asked, self.top = asked, np.full(len(asked), np.nan)  # of the flight that goes on, nan: not seen whole
        self.count, self.total = np.zeros(len(asked)), np.zeros(len(asked))

    def add(self, height: NDArray[np.float32], flying: NDArray[np.bool_], counted: NDArray[np.bool_]) -> None:
        """Take in a step; a flight that began before the first one does not count."""
        landed = counted & ~flying & np.isfinite(self.top)
        self.count += landed
        self.total += np.where(landed, np.abs(np.where(landed, self.top, 0.0) - self.asked), 0.0)
        self.top = np.where(flying, np.maximum(self.top, height), -np.inf)

    def mean(self) -> Array:
        """Over the flights; UNJUMPED where there is none."""
        return np.where(self.count > 0, self.total / np.maximum(self.count, 1.0), UNJUMPED)


class TrySums:
    """Sums over the steps of a try of W worlds, each until it falls."""

    def __init__(self, side: Array, phase: float, steps: int, dt: float, apex: Array) -> None:
        """apex: height of the body that jumps are to reach (W,), m."""
        self.steps, self.dt, self.settled = steps, dt, int(SETTLED * steps)
        self.times, self.apexes = TouchdownTimes.of(side, phase), ApexErrors(apex)
        self.upright = np.ones(len(side), bool)
        self.lasted, self.travelled, self.flown, self.work = (np.zeros(len(side)) for _ in range(4))
        self.late = np.zeros((2, len(side)))  # steps once settled, and the speeds there
        self.latest = np.zeros((2, len(side)))  # those of the second half of these

    def add(
        self, step: int, side: Array, age: Array, terminated: NDArray[np.bool_], info: dict[str, NDArray[np.float32]]
    ) -> None:
        """Take in step `step`: side and age, s, of the last touchdown and what the worlds tell."""
        self.upright &= ~terminated
        self.lasted += self.upright
        flying = np.asarray(~info["contact"].any(axis=1))
        self.flown += self.upright & flying
        self.work += np.where(self.upright, info["positive_power"], 0.0)
        moved = np.where(self.upright, info["forward_velocity"], 0.0)
        self.travelled += moved
        if step >= self.settled:
            self.late += self.upright, moved
            if 2 * step >= self.settled + self.steps:
                self.latest += self.upright, moved
            self.apexes.add(info["features"][:, BODY_Y], flying, self.upright)
        self.times.add(side, (step + 1) * self.dt - age, self.upright)

    def tries(self) -> Tries:
        """What it amounts to."""
        lasted, late = np.maximum(self.lasted, 1.0), np.maximum(self.late[0], 1.0)
        speed = np.where(self.late[0] > 0, self.late[1] / late, self.travelled / lasted)
        at_last = self.latest[1] / np.maximum(self.latest[0], 1.0)
        return Tries(
            upright=self.lasted / self.steps,
            speed=speed,
            drift=np.where(self.latest[0] > 0, np.abs(at_last - speed), 0.0),
            limp=self.times.spread(),
            flight=self.flown / lasted,
            power=self.work / lasted,
            apex_error=self.apexes.mean(),
        )
