"""What the controller with a clock begins with in each gait: the knots of its curves and the first values there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Part = tuple[str, tuple[float, ...], float]


@dataclass(frozen=True)
class GaitClock:
    """The clock of a gait, in cycles of one leg from its touchdown.

    rate: cycles per sqrt(L0 / g), what an exponent of 0 stands for; parts: name, first values and first deviation of
    the parameters, angles in rad, the rest in shares of what the motors can.
    """

    rate: float
    stance_knots: tuple[float, ...]
    swing_knots: tuple[float, ...]
    parts: tuple[Part, ...]

    @cached_property
    def mean(self) -> Array:
        """First values of all parameters (n,)."""
        return np.array([value for _, values, _ in self.parts for value in values])

    @cached_property
    def deviation(self) -> Array:
        """Their first deviations (n,)."""
        return np.array([deviation for _, values, deviation in self.parts for _ in values])


def parts(
    *,
    torque: Sequence[float],
    drive: Sequence[float],
    angle: Sequence[float],
    swing_drive: Sequence[float],
    placement: float,
    spread: float,
) -> tuple[Part, ...]:
    """The parameters of a gait in their order; spread: first deviation of the torque of the stance."""
    return (
        ("log_rate", (0.0,), 0.2),
        ("stance_torque", tuple(torque), spread),
        ("stance_drive", tuple(drive), 0.4),
        ("push", (0.0,), 0.1),
        ("swing_angle", tuple(angle), 0.15),
        ("swing_drive", tuple(swing_drive), 0.4),
        ("log_stiffness", (0.0,), 0.4),
        ("log_damping", (0.0,), 0.4),
        ("placement", (placement,), 0.07),
    )


RUN = GaitClock(
    rate=0.445,  # 1.47 strides/s of human legs
    stance_knots=(0.0, 0.15, 0.3, 0.5),
    swing_knots=(0.25, 0.5, 0.75, 1.0),
    parts=parts(
        torque=(-0.3, -0.3, -0.3, 0.0),
        drive=(0.2, 0.6, 0.6, 0.3),
        angle=(-0.2, 0.2, 0.4, 0.35),
        swing_drive=(-0.5, -0.8, 0.3, 0.5),
        placement=0.1,
        spread=0.4,
    ),
)
WALK = GaitClock(
    rate=0.29,  # 0.95 strides/s
    stance_knots=(0.0, 0.15, 0.3, 0.45, 0.6),
    swing_knots=(0.5, 0.65, 0.8, 1.0),
    parts=parts(
        torque=(-0.2, -0.1, -0.1, -0.1, 0.0),
        drive=(0.2, 0.5, 0.5, 0.5, 0.6),
        angle=(-0.35, 0.0, 0.35, 0.35),
        swing_drive=(0.0, -0.6, -0.3, 0.5),
        placement=0.05,
        spread=0.3,
    ),
)
HOP = GaitClock(
    rate=0.66,  # 2.2 hops/s
    stance_knots=(0.0, 0.15, 0.3, 0.5),
    swing_knots=(0.5, 0.75, 1.0, 1.15),
    parts=parts(
        torque=(-0.1, -0.1, -0.1, 0.0),
        drive=(0.2, 0.6, 0.6, 0.3),
        angle=(0.0, 0.1, 0.15, 0.15),
        swing_drive=(0.0, -0.3, 0.3, 0.5),
        placement=0.1,
        spread=0.3,
    ),
)
JUMP = GaitClock(
    rate=0.33,  # 1.1 jumps/s, of 0.3 m
    stance_knots=(0.0, 0.12, 0.24, 0.36, 0.5),
    swing_knots=(0.4, 0.7, 1.0, 1.15),
    parts=parts(
        torque=(0.0, 0.0, 0.0, 0.0, 0.0),
        drive=(-0.2, -0.3, 0.3, 0.8, 0.8),
        angle=(0.0, 0.0, 0.0, 0.0),
        swing_drive=(0.0, 0.0, 0.3, 0.5),
        placement=0.1,
        spread=0.2,
    ),
)
SKIP = GaitClock(
    rate=0.5,
    stance_knots=(0.0, 0.15, 0.3, 0.45),
    swing_knots=(0.35, 0.55, 0.8, 1.0),
    parts=parts(
        torque=(-0.2, -0.2, -0.2, 0.0),
        drive=(0.2, 0.6, 0.6, 0.3),
        angle=(-0.2, 0.1, 0.3, 0.3),
        swing_drive=(-0.3, -0.7, 0.3, 0.5),
        placement=0.1,
        spread=0.4,
    ),
)
CLOCKS = {"run": RUN, "walk": WALK, "hop": HOP, "skip": SKIP, "jump": JUMP}
"""By `teacher.gait`."""
