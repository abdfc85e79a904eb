"""What a student that follows commands may be asked for, once it is trained: gaits, speeds of each, styles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from romgrl.config.commanded import USUAL_STIFFNESS
from romgrl.config.values import refusal
from romgrl.errors import ConfigurationError

RANGE_SLACK = 1e-6
"""m/s by which a speed may lie outside a range."""
Ends = tuple[float, float]


class AskedCommand(NamedTuple):
    """A command of one gait: speed, m/s, 0 to stand, and style, share of a leg's stiffness."""

    speed: float
    gait: str
    style: float = USUAL_STIFFNESS


@dataclass(frozen=True)
class CommandLimits:
    """Slowest and fastest speed of each gait by its name, m/s, in the order of the weights; whether it was trained to
    stand; least and largest style."""

    speeds: dict[str, Ends]
    stands: bool
    styles: Ends = (USUAL_STIFFNESS, USUAL_STIFFNESS)

    @classmethod
    def of(cls, cells: Iterable[tuple[str, float]], standing_share: float) -> CommandLimits:
        """Those of the gaits and speeds, m/s, of cells."""
        speeds: dict[str, list[float]] = {}
        for gait, speed in cells:
            speeds.setdefault(gait, []).append(float(speed))
        return cls({gait: (min(speeds[gait]), max(speeds[gait])) for gait in sorted(speeds)}, standing_share > 0)

    @property
    def text(self) -> str:
        """All that is allowed, in words."""
        ranges = [f"{gait} {low:g} to {high:g} m/s" for gait, (low, high) in self.speeds.items()]
        return ", ".join([*(["0 (to stand)"] if self.stands else []), *ranges])

    @property
    def slowest(self) -> AskedCommand:
        """The slowest command of the first gait."""
        gait, (low, _) = next(iter(self.speeds.items()))
        return AskedCommand(low, gait)

    def columns(self, asked: AskedCommand) -> list[float]:
        """Speed, a weight for each gait, and style: the command as a policy sees it."""
        return [asked.speed, *(float(gait == asked.gait) for gait in self.speeds), asked.style]

    def begun(self, speed: float, preferred: str, why: str = "as the student was taught") -> AskedCommand:
        """The command with which a walker begins at a speed, m/s: in the preferred gait where that has the speed, else
        in the first that has. Raises ConfigurationError where none has, which says why these are all."""
        gaits = sorted(self.speeds, key=lambda gait: gait != preferred)
        for gait in gaits:
            low, high = self.speeds[gait]
            if (speed == 0 and self.stands) or low - RANGE_SLACK <= speed <= high + RANGE_SLACK:
                return AskedCommand(speed, gait)
        raise ConfigurationError(refusal("speed", speed, f"{self.text}, {why}"))
