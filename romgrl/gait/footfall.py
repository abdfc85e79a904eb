"""Gaits by their footfall: when the feet touch down, and how much of the time neither is on the ground."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Footfall:
    """What tells a gait from others.

    phase: of the right foot's touchdown in the stride of the left one; off: how far from it, in strides, a gait may be;
    flight: range of the share of the time in which no foot is on the ground; correlation: the highest of left and right
    foot x; lowest: the least height of the body over its median; a fall ends lower.
    """

    phase: float
    flight: tuple[float, float]
    correlation: float = 1.0
    off: float = 0.5
    lowest: float = 0.7

    @property
    def together(self) -> bool:
        """Both feet land at once: a hop."""
        return self.phase == 0.0


ALTERNATING = -0.5  # the highest correlation of feet that take turns
FOOTFALLS = {
    "walk": Footfall(0.5, flight=(0.0, 0.02), correlation=ALTERNATING),
    "run": Footfall(0.5, flight=(0.0, 0.8), correlation=ALTERNATING),
    "hop": Footfall(0.0, flight=(0.1, 0.8), off=0.1),
    "jump": Footfall(0.0, flight=(0.2, 0.9), off=0.1, lowest=0.4),
    "skip": Footfall(0.3, flight=(0.02, 0.8), off=0.12),
}
"""By `teacher.gait`. Minetti 1998, Proc. R. Soc. B 265, for the skip; a run may have no flight where it is slow."""
