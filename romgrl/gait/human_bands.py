"""Human gait as a yardstick: bands of the numbers in gait.csv and library.csv over speed, each with its source.

The data are in human_bands.csv; docs/method.md lists the references. Between two speeds of one gait a band is
interpolated linearly; at other speeds there is none. A measure that is known at one speed has one there alone.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import groupby, pairwise
from pathlib import Path

ON_TWO_FEET = ("walk", "run")
"""What people do at one speed or another: a walker is held to the one that they would choose."""
COMPARED_WITH = {"walk": ON_TWO_FEET, "run": ON_TWO_FEET, "hop": ("hop",)}
"""Gaits that have bands, by `teacher.gait`."""
TABLE = Path(__file__).with_suffix(".csv")
POWER = "positive_power_w_per_kg"
ENERGY = (POWER, "cost_of_transport")
"""Of the joints, tendons included."""
ON_SPRINGS = "positive_power_without_retraction_w_per_kg"
"""A walker that has this number is the reduced-order model: what its springs give back is in none of its numbers."""


@dataclass(frozen=True)
class Band:
    """What human adults show of one measure: low <= value <= high, in the unit that ends the measure's name."""

    gait: str  # walk, run or hop
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


def bands(speed: float, gaits: Collection[str] = ON_TWO_FEET) -> dict[str, Band]:
    """The bands of some gaits at a speed (m/s) by measure.

    None outside the speeds of the table and between walking and running.
    """
    found: dict[str, Band] = {}
    known = sorted((band for band in table() if band.gait in gaits), key=_order)
    for (_, measure), rows in groupby(known, key=lambda band: (band.gait, band.measure)):
        at = list(rows)
        for slower, faster in pairwise([at[0], *at]):
            if slower.speed <= speed <= faster.speed:
                found[measure] = _between(slower, faster, speed)
    return found


def outside(row: Mapping[str, float], speed: float, gaits: Collection[str] = ON_TWO_FEET) -> dict[str, Band]:
    """The bands at a speed that a row of gait.csv or library.csv leaves; empty where all hold or there are none."""
    values = {**row, "stride_length_m": stride_length(row)}
    return {name: band for name, band in bands_for(values, speed, gaits).items() if not band.holds(values[name])}


def stride_length(row: Mapping[str, float]) -> float:
    """Steady speed over stride frequency, m; nan where nothing strides."""
    rate = row["stride_frequency_hz"]
    return row["steady_speed_m_per_s"] / rate if rate > 0 else float("nan")


def human_verdict(row: Mapping[str, float], speed: float, gaits: Collection[str] = ON_TWO_FEET) -> str:
    """One line: which numbers of a row of gait.csv are human at this speed, and which are not."""
    values = {**row, "stride_length_m": stride_length(row)}
    known, off = bands_for(values, speed, gaits), outside(row, speed, gaits)
    if not known:
        return f"no human bands at {speed:g} m/s" if gaits else "no human bands of such a gait"
    if not off:
        return "in all human bands: " + ", ".join(known)
    return "outside the human bands: " + ", ".join(
        f"{name} {values[name]:.3g} ({band.low:.3g} to {band.high:.3g})" for name, band in off.items()
    )


def bands_for(row: Mapping[str, float], speed: float, gaits: Collection[str] = ON_TWO_FEET) -> dict[str, Band]:
    """The bands at a speed of the measures that a row has: of ENERGY, where it was recorded of joints."""
    springs = math.isfinite(row.get(ON_SPRINGS, math.nan))
    lacking = {name for name in ENERGY if springs or not math.isfinite(row.get(name, math.nan))}
    return {name: band for name, band in bands(speed, gaits).items() if name in row and name not in lacking}


def _order(band: Band) -> tuple[str, str, float]:
    return band.gait, band.measure, band.speed


def _between(slower: Band, faster: Band, speed: float) -> Band:
    """Linear in speed; the source is that of the nearer row."""
    share = (speed - slower.speed) / (faster.speed - slower.speed) if faster.speed > slower.speed else 0.0
    low = slower.low + share * (faster.low - slower.low)
    high = slower.high + share * (faster.high - slower.high)
    return Band(slower.gait, speed, slower.measure, low, high, (slower if share < 0.5 else faster).source)
