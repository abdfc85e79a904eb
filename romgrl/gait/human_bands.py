"""Human gait as a yardstick: bands of the numbers in gait.csv at walking and running speeds, each with its source.

The data are in human_bands.csv; docs/method.md lists the references. Between two speeds of one gait a band is
interpolated linearly; at other speeds there is none. A measure that is known at one speed has one there alone.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import groupby, pairwise
from pathlib import Path

OF_PEOPLE = ("walk", "run")
TABLE = Path(__file__).with_suffix(".csv")
POWER = "positive_power_w_per_kg"
ENERGY = (POWER, "cost_of_transport")
"""Of the joints, tendons included."""
ON_SPRINGS = "positive_power_without_retraction_w_per_kg"
"""A walker that has this number is the reduced-order model: what its springs give back is in none of its numbers."""


@dataclass(frozen=True)
class Band:
    """What human adults show of one measure: low <= value <= high, in the unit that ends the measure's name."""

    gait: str  # walk or run
    speed: float  # m/s
    measure: str
    low: float
    high: float
    source: str

    def holds(self, value: float) -> bool:
        """True for a value in the band; nan is in none."""
        return self.low <= value <= self.high


@cache
def table() -> tuple[Band, ...]:
    """All rows of human_bands.csv."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        return tuple(
            Band(
                row["gait"],
                float(row["speed_m_per_s"]),
                row["measure"],
                float(row["low"]),
                float(row["high"]),
                row["source"],
            )
            for row in csv.DictReader(file)
        )


def bands(speed: float) -> dict[str, Band]:
    """The bands at a speed (m/s) by measure; none outside the speeds of the table and between walking and running."""
    found: dict[str, Band] = {}
    for (_, measure), rows in groupby(sorted(table(), key=_order), key=lambda band: (band.gait, band.measure)):
        known = list(rows)
        for slower, faster in pairwise([known[0], *known]):
            if slower.speed <= speed <= faster.speed:
                found[measure] = _between(slower, faster, speed)
    return found


def outside(row: Mapping[str, float], speed: float) -> dict[str, Band]:
    """The bands at a speed that a row of gait.csv leaves; empty where all hold or there are none."""
    values = {**row, "stride_length_m": stride_length(row)}
    return {name: band for name, band in bands_for(values, speed).items() if not band.holds(values[name])}


def stride_length(row: Mapping[str, float]) -> float:
    """Steady speed over stride frequency, m; nan where nothing strides."""
    rate = row["stride_frequency_hz"]
    return row["steady_speed_m_per_s"] / rate if rate > 0 else float("nan")


def human_verdict(row: Mapping[str, float], speed: float) -> str:
    """One line: which numbers of a row of gait.csv are human at this speed, and which are not."""
    known, off = bands_for(row, speed), outside(row, speed)
    if not known:
        return f"no human bands at {speed:g} m/s"
    if not off:
        return "in all human bands: " + ", ".join(known)
    values = {**row, "stride_length_m": stride_length(row)}
    return "outside the human bands: " + ", ".join(
        f"{name} {values[name]:.3g} ({band.low:.3g} to {band.high:.3g})" for name, band in off.items()
    )


def bands_for(row: Mapping[str, float], speed: float) -> dict[str, Band]:
    """The bands at a speed that a row of gait.csv can be held to: for ENERGY, where it was recorded of joints."""
    springs = math.isfinite(row.get(ON_SPRINGS, math.nan))
    known = {name for name in ENERGY if math.isfinite(row.get(name, math.nan)) and not springs}
    return {name: band for name, band in bands(speed).items() if name not in ENERGY or name in known}


def _order(band: Band) -> tuple[str, str, float]:
    return band.gait, band.measure, band.speed


def _between(slower: Band, faster: Band, speed: float) -> Band:
    """Linear in speed; the source is that of the nearer row."""
    share = (speed - slower.speed) / (faster.speed - slower.speed) if faster.speed > slower.speed else 0.0
    low = slower.low + share * (faster.low - slower.low)
    high = slower.high + share * (faster.high - slower.high)
    return Band(slower.gait, speed, slower.measure, low, high, (slower if share < 0.5 else faster).source)
