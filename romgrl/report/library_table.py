"""The library of a teacher's gaits as the table that ends a run, and as numbers of it."""

from __future__ import annotations

import math
from pathlib import Path

from rich.table import Table

from romgrl.report.library_cells import goal_text, said_of
from romgrl.report.numbers import UNKNOWN, significant
from romgrl.report.terminal_tables import Rows, number, read_rows

LIBRARY_TABLE = "library.csv"
SHOWN = {
    "stiffness_share": "stiffness",
    "steady_speed_m_per_s": "speed [m/s]",
    "jump_apex_m": "apex [m]",
    "falls": "falls",
    "stride_frequency_hz": "strides [Hz]",
    "duty_factor": "duty factor",
    "pelvis_excursion_m": "excursion [m]",
    "peak_force_body_weights": "peak force [body weights]",
    "positive_work_j_per_kg_m": "work [J/kg/m]",
    "multiplier": "multiplier",
}
"""Columns of the table, by those of library.csv."""


def library_tables(library: Path) -> list[Table]:
    """A row for each cell: what it measures, and why it is refused or leaves the human bands; none without any."""
    rows = read_rows(library / LIBRARY_TABLE)
    if not rows:
        return []
    table = Table(title="Library", title_justify="left")
    several = len({row["gait"] for row in rows}) > 1
    if several:
        table.add_column("gait")
    table.add_column("asked", justify="right")
    shown = {name: label for name, label in SHOWN.items() if any(row.get(name) for row in rows)}
    for label in shown.values():
        table.add_column(label, justify="right")
    table.add_column("fit")
    for row in rows:
        values = [significant(number(row[name])) if name in row else UNKNOWN for name in shown]
        numbers = {name: number(value) for name, value in row.items()}
        goal = goal_text(numbers["speed_m_per_s"], number(row.get("apex_m", "0")))
        fit = said_of(row["fit"] == "True", row["reason"], numbers, row["gait"])
        table.add_row(*([row["gait"]] if several else []), goal, *values, fit)
    return [table]


def library_line(library: Path) -> str:
    """How many cells of a library are fit, and where they can be seen."""
    rows = read_rows(library / LIBRARY_TABLE)
    fit = sum(row["fit"] == "True" for row in rows)
    return f"library: {fit} of {len(rows)} cells are fit to be imitated, see {library / 'report.html'}"


def library_metrics(library: Path) -> dict[str, float]:
    """How many cells there are, which share of them is fit, and the largest multiplier of those; none without any."""
    rows: Rows = read_rows(library / LIBRARY_TABLE)
    if not rows:
        return {}
    fit = [row for row in rows if row["fit"] == "True"]
    multipliers = [value for row in fit if math.isfinite(value := number(row.get("multiplier", "")))]
    found = {"cells": float(len(rows)), "fit_percent": 100.0 * len(fit) / len(rows)}
    return found | ({"largest_multiplier": max(multipliers)} if multipliers else {})
