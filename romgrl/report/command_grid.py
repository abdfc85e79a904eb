"""What an evaluation of a student that follows commands has measured: its tables, and the words for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from romgrl.gait import human_bands
from romgrl.gait.features import Floats
from romgrl.gait.measures import MEASURES
from romgrl.report.grid_tables import WALKER_ORDER
from romgrl.report.numbers import significant

ERROR = "error_over_variance"
HELD = "steady_speed_m_per_s"
FALLS = "falls_percent"
"""Of the episodes; the one column that is made of others."""
GRID_MEASURES = {
    HELD: "speed held [m/s]",
    ERROR: "error over variance",
    "stride_frequency_hz": "stride frequency [Hz]",
    "duty_factor": "duty factor",
    "pelvis_excursion_m": "vertical excursion [m]",
    "touchdown_phase_strides": "touchdown phase [strides]",
    "cost_of_transport": "cost of transport",
    FALLS: "falls [%]",
}
"""Columns of grid.csv that are drawn, and what stands over their charts; a grid may lack some."""
SHOWN_NULLS = ("statue", "sinusoid")
"""Walkers of grid.csv that learned nothing, and have an error alone."""
GRID_COLUMNS = ("walker", "gait", "speed_m_per_s", "taught", "episodes", "falls", "speed_held", ERROR, HELD)
SPEED_LABEL = "speed asked for [m/s]"


@dataclass(frozen=True)
class GridTables:
    """grid.csv with FALLS; of the student confusion.csv and mmd.csv, indexed by what was asked; transitions.csv of all.

    summary: grid.json.
    """

    grid: pd.DataFrame
    confusion: pd.DataFrame
    mmd: pd.DataFrame
    transitions: pd.DataFrame
    summary: Mapping[str, Any]

    @property
    def student(self) -> pd.DataFrame:
        """The student's rows of the grid, by gait and speed."""
        return rows_of(self.grid, "student")

    @property
    def seen_percent(self) -> Floats:
        """Of the episodes that are asked for a gait (rows), those of each gait (columns)."""
        counts = self.confusion.to_numpy(float)
        return np.asarray(100.0 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0))

    @property
    def distances(self) -> Floats:
        """mmd.csv as it is drawn: an estimate of a square may be below zero."""
        return np.asarray(np.maximum(self.mmd.to_numpy(float), 0.0))


@dataclass(frozen=True)
class GridLine:
    """The cells of one walker and gait by speed; rows: of grid.csv."""

    walker: str
    gait: str
    rows: pd.DataFrame


def with_falls_percent(grid: pd.DataFrame) -> pd.DataFrame:
    """grid.csv with FALLS."""
    return grid.assign(**{FALLS: 100.0 * grid.falls / grid.episodes, "taught": grid.taught.astype(bool)})


def rows_of(grid: pd.DataFrame, walker: str) -> pd.DataFrame:
    """The rows of a walker, by gait and speed, numbered anew."""
    return grid[grid.walker == walker].sort_values(["gait", "speed_m_per_s"]).reset_index(drop=True)


def grid_lines(grid: pd.DataFrame) -> Iterator[GridLine]:
    """Yield the cells of each walker and gait, the student last, on top."""
    for walker in reversed(WALKER_ORDER):
        for gait, rows in rows_of(grid, walker).groupby("gait"):
            yield GridLine(walker, str(gait), rows)


def cell_name(gait: str, speed: float) -> str:
    """As mmd.csv names a cell: `run 3.25`."""
    return f"{gait} {speed:g}"


def measured_text(measure: str, value: float) -> str:
    """A number of the grid with the decimals of its measure; errors, which go over decades, to three digits."""
    if measure == ERROR or not np.isfinite(value):
        return significant(value)
    return f"{value:.{MEASURES[measure].decimals}f}"


def said_of_cell(row: pd.Series) -> str:
    """What a student does at a cell, in words; row: of grid.csv."""
    asked, falls = float(row.speed_m_per_s), int(row.falls)
    held = "held" if bool(row.speed_held) else "not held"
    parts = [f"{held}: {significant(float(row[HELD]))} m/s"] if np.isfinite(row[HELD]) else ["no steady speed"]
    if falls:
        parts.append(f"falls in {falls} of {row.episodes:.0f} episodes")
    numbers = {str(name): float(value) for name, value in row.items() if isinstance(value, (int, float, np.number))}
    numbers["stride_length_m"] = human_bands.stride_length(numbers)
    bands = human_bands.outside(numbers, asked, human_bands.COMPARED_WITH.get(str(row.gait), ()))
    off = [name for name in bands if np.isfinite(numbers[name])]
    if off:
        parts.append(f"not human: {', '.join(MEASURES[name].label for name in off)}")
    return "; ".join(parts) + ("" if row.taught else "; its reference was never seen in training")


@dataclass(frozen=True)
class Verdict:
    """A bar of grid.json: what it is about, the bar, what each walker comes to, and whether the student reaches it."""

    question: str
    bar: str
    values: list[str]
    reached: bool | None

    @property
    def mark(self) -> str:
        """In a word."""
        return "not measured" if self.reached is None else "reached" if self.reached else "missed"


def verdicts(summary: Mapping[str, Any]) -> list[Verdict]:
    """Of grid.json; values: of WALKER_ORDER."""
    return [
        Verdict(
            each["meaning"],
            f"{each['way']} {each['bar']:g}",
            [significant(np.nan if each.get(name) is None else each[name]) for name in WALKER_ORDER],
            each["reached"],
        )
        for each in summary["bars"]
    ]


def row_minima(matrix: pd.DataFrame) -> Floats:
    """Column (C,) of each row's least entry, nan where a row has none."""
    values = matrix.to_numpy(float)
    known = np.isfinite(values).any(axis=1)
    return np.where(known, np.nan_to_num(values, nan=np.inf).argmin(axis=1), np.nan)
