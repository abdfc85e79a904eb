"""The cells of a library: what of them is drawn, in which lines, beside which human bands, and what is said of one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from romgrl.gait import human_bands
from romgrl.gait.features import Floats
from romgrl.gait.measures import MEASURES

if TYPE_CHECKING:
    import pandas as pd

MEASURED_CELLS = {
    "steady_speed_m_per_s": "speed held [m/s]",
    "jump_apex_m": "apex of jumps [m]",
    "stride_frequency_hz": "stride frequency [Hz]",
    "duty_factor": "duty factor",
    "pelvis_excursion_m": "vertical excursion [m]",
    "peak_force_body_weights": "peak force [body weights]",
    "net_extension_m": "net leg extension [m]",
    "positive_work_j_per_kg_m": "positive work [J/kg/m]",
    "multiplier": "largest Floquet multiplier",
    "falls": "falls",
}
"""Columns of library.csv, and what stands over their panels; a library may lack some."""
BANDS_ALONE = {"force_valley": "valley of the force"}
"""Columns of library.csv that have human bands and are not drawn."""
ASKED = {"steady_speed_m_per_s": "speed_m_per_s", "jump_apex_m": "apex_m"}
"""The columns of what is asked for, by those of what it came to."""
FEET = {"foot_radius_m": "foot_radius", "roll_over_radius_m": "roll_over_radius"}
"""What the player draws of a model's feet, by columns of library.csv."""
BAND_POINTS = 101
REACH = 0.1  # m/s: how far the bands go to both sides of a table of one speed


def goals(table: pd.DataFrame) -> pd.Series:
    """What each cell of library.csv was asked for: a speed, m/s, or an apex, m, of jumps."""
    apex = table.get("apex_m", 0.0 * table.speed_m_per_s)
    return table.speed_m_per_s.where(apex == 0, apex)


def feet_of_cells(table: pd.DataFrame) -> list[dict[str, float]]:
    """What the player draws of the feet of each cell of library.csv, m."""
    return [dict(zip(FEET.values(), feet, strict=True)) for feet in table[[*FEET]].to_numpy(float).tolist()]


def goal_text(speed: float, apex: float) -> str:
    """A goal in words, as in `1.25 m/s`."""
    return f"{apex:g} m" if apex else f"{speed:g} m/s"


def goal_label(table: pd.DataFrame) -> str:
    """What stands at the axis of goals."""
    jumps = table.apex_m > 0
    if jumps.all():
        return "apex asked for [m]"
    return "asked for [m/s, of jumps m]" if jumps.any() else "speed asked for [m/s]"


@dataclass(frozen=True)
class CellLine:
    """Cells of one stiffness, and of one gait where a library has several, by goal. rows: of library.csv.

    gait: "" where there is one alone. color and dash: the numbers of the gait and of the stiffness, and where there is
    one gait alone of the stiffness and 0.
    """

    share: float
    gait: str
    color: int
    dash: int
    rows: pd.DataFrame

    @property
    def label(self) -> str:
        """As in `walk, stiffness × 0.7`."""
        return ", ".join(part for part in (self.gait, f"stiffness × {self.share:g}") if part)


def cell_lines(table: pd.DataFrame) -> list[CellLine]:
    """The lines of library.csv: one for each stiffness and gait that it has."""
    gaits, shares = np.unique(table.gait).tolist(), np.unique(table.stiffness_share).tolist()
    found = []
    for (stiffness, share), (number, gait) in product(enumerate(shares), enumerate(gaits)):
        rows = table[(table.stiffness_share == share) & (table.gait == gait)]
        rows = rows.sort_values(["speed_m_per_s", "apex_m"])
        seen = (number, stiffness) if len(gaits) > 1 else (stiffness, 0)
        if len(rows):
            found.append(CellLine(share, gait if len(gaits) > 1 else "", *seen, rows))
    return found


def drawn_cells(table: pd.DataFrame, measure: str) -> pd.DataFrame:
    """The rows of library.csv among which a measure is compared: jumps are not with what goes at a speed."""
    jumps = table.apex_m > 0
    kept = jumps if measure == "jump_apex_m" else ~jumps
    return table[kept] if kept.any() else table


def band_curve(measure: str, table: pd.DataFrame) -> tuple[Floats, Floats, Floats]:
    """Goals (N,) over those of library.csv, and what people show of a measure at such speeds, low and high (N,).

    nan: nothing is known. Bands are of walks and runs where the table has one of them, else of its gait.
    """
    low, high = float(goals(table).min()), float(goals(table).max())
    own = {human_bands.COMPARED_WITH.get(gait, ()) for gait in table.gait}
    gaits = human_bands.ON_TWO_FEET if human_bands.ON_TWO_FEET in own else {gait for each in own for gait in each}
    reach = 0.0 if high > low else REACH
    places = np.linspace(low - reach, high + reach, BAND_POINTS)
    bands = [human_bands.bands(float(speed), gaits).get(measure) for speed in places]
    ends = [(np.nan, np.nan) if band is None else (band.low, band.high) for band in bands]
    return places, *np.array(ends).T


def said_of(fit: bool, reason: str, values: Mapping[str, float], gait: str) -> str:
    """Why a cell is refused, or which human bands it leaves, where there are any; values: the numbers of its row."""
    if not fit:
        return reason
    speed, gaits = values["speed_m_per_s"], human_bands.COMPARED_WITH.get(gait, ())
    if not human_bands.bands(speed, gaits):
        return "yes; no human bands here"
    off = human_bands.outside(values, speed, gaits)
    return f"yes; not human: {', '.join(map(band_label, off))}" if off else "yes"


def band_label(measure: str) -> str:
    """What a measure that has human bands is called, without its unit."""
    return (
        MEASURES[measure].label if measure in MEASURES else (MEASURED_CELLS | BANDS_ALONE)[measure].partition(" [")[0]
    )
