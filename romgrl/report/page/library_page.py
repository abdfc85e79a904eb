"""report.html of a library: the gait atlas as one page that plays every cell, with nothing to install."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.gait.features import BODY_Y
from romgrl.report.finished_library import RECORDED
from romgrl.report.library_cells import (
    ASKED,
    MEASURED_CELLS,
    CellLine,
    cell_lines,
    feet_of_cells,
    goal_text,
    goals,
    said_of,
)
from romgrl.report.numbers import significant
from romgrl.report.page.html import render_page
from romgrl.report.page.library_charts import atlas_charts, footfall_charts, line_color
from romgrl.report.page.scene import recording, rom_points
from romgrl.report.page.stretches import Stretch, steady_stretch
from romgrl.rom.drawing import TRUNK

LEAST_TOP = 1.15  # m
BORDERS = ("solid", "dashed", "dotted", "double")  # of gaits in the legend
NEIGHBORS = {
    "library.csv": "a row for each cell",
    "library.npz": "the references",
    "gait_atlas.png": "the atlas as a picture",
    "gait_atlas.pdf": "for print",
}
"""What lies beside the page."""
GOALS = {"speed_m_per_s": "speed_m_per_s", "apex_m": "apex_m"}
HELD = {asked: held for held, asked in ASKED.items()}
"""Columns of library.csv by those of what is asked for: these themselves, and what it came to."""


def write_library_page(path: Path, table: pd.DataFrame, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the page. table, arrays: library.csv and library.npz."""
    table = table.reset_index(drop=True).fillna({"reason": ""})
    dt, lines = float(arrays["dt"]), cell_lines(table)
    recorded = zip(*(arrays[name] for name in RECORDED), strict=True)
    stretches = [steady_stretch(*cell, dt=dt) for cell in recorded]
    values = table.select_dtypes("number").astype(float).to_dict("records")
    numbers = [{str(name): float(value) for name, value in row.items()} for row in values]
    cells = zip(table.fit, table.reason, numbers, table.gait, strict=True)
    said = [said_of(*cell) for cell in cells]
    measures = {name: label for name, label in MEASURED_CELLS.items() if name in table}
    texts = [[significant(row[name]) for name in measures] for row in numbers]
    named = [goal_text(*asked) for asked in zip(table.speed_m_per_s, table.apex_m, strict=True)]
    labels = {cell: line.label for line in lines for cell in line.rows.index}
    render_page(
        path,
        name="library",
        scene={
            "dt": dt,
            "top": top_of(stretches),
            "walkers": played_cells(stretches),
            "lines": [
                {"gait": line.gait, "share": line.share, "color": line_color(line), "cells": line.rows.index.tolist()}
                for line in lines
            ],
            "cells": [
                {"asked": goal, "goal": words, "fit": bool(fit), "said": why, "numbers": shown, **drawn}
                for goal, words, fit, why, shown, drawn in zip(
                    goals(table), named, table.fit, said, texts, feet_of_cells(table), strict=True
                )
            ],
            "start": first_cell(lines),
        },
        sections={
            "atlas": atlas_charts(table, lines, said),
            "footfall": footfall_charts(lines, stretches, dt),
        },
        title="Gait atlas",
        headline=headline_of(table),
        setting=setting_of(table),
        colors={},
        legend=[(line.label, line_color(line), BORDERS[line.dash % len(BORDERS)]) for line in lines],
        gaits=list(dict.fromkeys(line.gait for line in lines)),
        measures=list(measures.values()),
        rows=[
            [goal, labels[cell], words, *shown]
            for cell, (goal, shown, words) in enumerate(zip(named, texts, said, strict=True))
        ],
        hertz=f"{1.0 / dt:.0f}",
        files=NEIGHBORS,
    )


def played_cells(stretches: Sequence[Stretch | None]) -> dict[str, dict[str, Any]]:
    """What the player draws of each cell that has a steady stretch, by its number."""
    return {
        str(cell): recording(rom_points(stretch.features), stretch.x, stretch.contact, stretch.strides)
        for cell, stretch in enumerate(stretches)
        if stretch is not None
    }


def top_of(stretches: Sequence[Stretch | None]) -> float:
    """Height of the player's picture, m: of the highest trunk."""
    highest = (float(stretch.features[:, BODY_Y].max()) for stretch in stretches if stretch is not None)
    return round(max([LEAST_TOP, *(height + TRUNK for height in highest)]), 3)


def first_cell(lines: Sequence[CellLine]) -> int:
    """The cell that is shown first: the middle one of those that are fit, in the line that has most of them."""
    rows = max((line.rows for line in lines), key=lambda cells: int(cells.fit.sum()))
    kept = rows[rows.fit] if rows.fit.any() else rows
    return int(kept.index[len(kept) // 2])


def headline_of(table: pd.DataFrame) -> str:
    """How many cells are fit, of which gaits, at which speeds or apexes, and what was asked for."""
    fit, gaits = table[table.fit], table.groupby("gait").fit
    of_each = ", ".join(f"{gait}: {int(own.sum())} of {len(own)}" for gait, own in gaits)
    each = f" ({of_each})" if len(gaits) > 1 else ""
    held = f", at {goal_spans(fit)} (held: {goal_spans(fit, HELD)})" if len(fit) else ""
    shares = ", ".join(f"{share:g}" for share in np.unique(table.stiffness_share))
    return (
        f"Fit to be imitated: {len(fit)} of {len(table)} cells{each}{held}. "
        f"Asked for: {goal_spans(table)}, stiffness × {shares}."
    )


def setting_of(table: pd.DataFrame) -> str:
    """Which teachers there are, in words."""
    teachers = list(dict.fromkeys(table.teacher))
    return f"{'Teachers' if len(teachers) > 1 else 'Teacher'}: {'; '.join(teachers)}."


def goal_spans(table: pd.DataFrame, columns: Mapping[str, str] = GOALS) -> str:
    """The range of the speeds, and of the apexes of jumps, as text; columns: of them, by those of what is asked for."""
    jumps = table.apex_m > 0
    values = {"m/s": table[~jumps][columns["speed_m_per_s"]]}
    if jumps.any():
        values["m"] = table[jumps][columns["apex_m"]]
    return " and ".join(f"{span_text(each)} {unit}" for unit, each in values.items() if len(each))


def span_text(values: pd.Series) -> str:
    """The least and the largest value, as text."""
    return " to ".join(dict.fromkeys(significant(value) for value in (values.min(), values.max())))
