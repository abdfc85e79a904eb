"""The weight of the task reward, steered by the checks of a student's gait (`student.adapt_eta`)."""

from __future__ import annotations

from collections.abc import Mapping

SPEED, CADENCE = 3.0, 5.0
"""Errors of speed and cadence, in percent, up to which they are right."""
LATE_ETA, MOST_ETA, ETA_FACTOR = 0.5, 0.7, 1.1
SECOND_ETA = 0.25
STANDING, STANDING_FACTOR, SPEED_FACTOR, FOLLOWS = 50.0, 1.5, 1.15, 1.5
ADAPTS_FROM, LATE_FROM = 0.32, 0.6
"""What the weight does not fall below late in a training, and its largest value; its change at a check where the
cadence is wrong (and what it is on a second try, which no check changes), where the walker is so many percent too slow
that it stands in a pose that pays, and where its speed is wrong; how many times the error of the speed that of a
cadence may be which follows from it; the shares of all steps that a student has to find its feet before, and from
which on it is late."""


def adapted(eta: float, row: Mapping[str, float], *, fell: bool) -> float:
    """The weight of the task reward after a check: more of it where the walker stands, or its speed is wrong and the
    cadence wrong with it, or its speed too low alone; less of it, and so more imitation, where the speed is too high
    alone, or the cadence is wrong alone, more, or to the other side; as it is where it passes, or `fell` too often.

    A speed that is too high alone is that of the mean action: what the task pays for, the exploring one, is slower."""
    if fell:
        return eta
    speed = row["speed_error_percent"]
    if speed < -STANDING:
        return max(eta, min(MOST_ETA, eta * STANDING_FACTOR))
    if another_stride(row):
        return eta / ETA_FACTOR
    right_cadence = abs(row["cadence_error_percent"]) <= CADENCE
    if abs(speed) > SPEED and not (right_cadence and speed > SPEED):
        return max(eta, min(MOST_ETA, eta * SPEED_FACTOR))
    return eta if speed <= SPEED else eta / ETA_FACTOR


def another_stride(row: Mapping[str, float]) -> bool:
    """Tell whether the cadence of a check is wrong, or there is none, and does not follow from the speed.

    It follows from a wrong speed where it errs to the same side, and at most FOLLOWS times as much.
    """
    speed, cadence = row["speed_error_percent"], row["cadence_error_percent"]
    follows = abs(speed) > SPEED and speed * cadence > 0 and abs(cadence) <= FOLLOWS * abs(speed)
    return not abs(cadence) <= CADENCE and not follows


def least_eta(first: float, share: float) -> float:
    """What the weight does not fall below at a share of a training that began with `first`: it rises from there."""
    late = min(1.0, max(0.0, (share - ADAPTS_FROM) / (LATE_FROM - ADAPTS_FROM)))
    return min(first, LATE_ETA) + late * max(0.0, LATE_ETA - first)
