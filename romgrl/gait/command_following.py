"""How a walker follows what it is asked for: free functions on speeds (T,) m/s and contacts (T, 2) of one episode."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from romgrl.gait.features import Bools, Floats
from romgrl.gait.metrics import touchdowns

RUNS_BELOW = 0.5
"""Duty factor below which a stride is one of a run (Alexander 1989); whole episodes: `romgrl.gait.gait_classes`."""
LEAST_TOLERANCE, TOLERANCE = 0.1, 0.05
"""A speed is held within so many m/s, or this share of it where that is more."""


class Stride(NamedTuple):
    """From one touchdown of a foot to its next: steps, and the share of them that the foot is on the ground."""

    start: int
    stop: int
    duty: float


def speed_tolerance(speed: float) -> float:
    """How far from a speed one may be that is held, m/s."""
    return max(LEAST_TOLERANCE, TOLERANCE * speed)


def running_mean(values: Floats, steps: int) -> Floats:
    """Mean of `values` (T,) over `steps` of them about each, over what is there of these at both ends."""
    behind = steps // 2
    total = np.concatenate(([0.0], np.cumsum(values)))
    first = np.clip(np.arange(len(values)) - behind, 0, None)
    last = np.clip(np.arange(len(values)) - behind + steps, None, len(values))
    return np.asarray((total[last] - total[first]) / (last - first))


def settling_time(speed: Floats, target: float, dt: float) -> float:
    """Seconds until a speed (T,) stays within `speed_tolerance` of the target to the end; nan where it does not."""
    off = np.flatnonzero(np.abs(speed - target) > speed_tolerance(target))
    settled = int(off[-1]) + 1 if len(off) else 0
    return settled * dt if settled < len(speed) else float("nan")


def overshoot(speed: Floats, before: float, target: float) -> float:
    """How far a speed (T,) goes beyond the target, seen from the one before; to either side where both are the same."""
    beyond = np.abs(speed - target) if target == before else np.sign(target - before) * (speed - target)
    return float(max(0.0, beyond.max()))


def strides(contact: Bools) -> list[Stride]:
    """The whole strides of both feet; contact (T, 2)."""
    found = []
    for foot in contact.T:
        found += [Stride(start, stop, float(foot[start:stop].mean())) for start, stop in pairwise(touchdowns(foot))]
    return found


def switching_speed(asked: Floats, duty: Floats) -> float:
    """Speed, m/s, at which duty factors (B,) cross 0.5 for good; asked (B,): speeds in the order in which they came.

    Straight between two of them; those that are not known are left out. nan where the first and the last are on one
    side, or none is known.
    """
    known = np.isfinite(duty)
    asked, duty = asked[known], duty[known]
    if not len(duty):
        return float("nan")
    runs = duty < RUNS_BELOW
    if runs[0] == runs[-1]:
        return float("nan")
    last = int(np.flatnonzero(runs != runs[-1])[-1])
    share = (RUNS_BELOW - duty[last]) / (duty[last + 1] - duty[last])
    return float(asked[last] + share * (asked[last + 1] - asked[last]))
