"""report.html of a student that follows commands: every cell of its grid on one page that plays them, and its ramp."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from numpy.typing import NDArray

from romgrl.artifacts import Manifest
from romgrl.gait.features import Floats
from romgrl.report.command_grid import GRID_MEASURES, GridTables, measured_text, said_of_cell, verdicts
from romgrl.report.grid_markdown import (
    GRID_MEANINGS,
    cost_said,
    grid_setting,
    grid_summary_text,
    ramp_said,
    transition_table,
)
from romgrl.report.grid_tables import GRID_LABELS, WALKER_ORDER
from romgrl.report.page import tables as origins
from romgrl.report.page.charts import Chart
from romgrl.report.page.command_charts import gaits_seen, grid_charts, matrix_charts, ramp_charts
from romgrl.report.page.html import render_page
from romgrl.report.page.library_charts import footfall_charts
from romgrl.report.page.played_cells import (
    CellReference,
    PlayedCell,
    cell_table,
    gait_lines,
    played_cells,
    played_walkers,
)
from romgrl.report.page.scene import humanoid_points, recording, segments
from romgrl.report.ramp_strides import RampStrides
from romgrl.report.style import COLORS, STUDENT, WALKER_LABELS

LEAST_TOP = 1.95  # m
GAIT_SIGNS = {"walk": "■", "run": "●", "hop": "▲", "skip": "◆"}


@dataclass(frozen=True)
class GridReport:
    """What a report of a student that follows commands is made from.

    arrays: recordings.npz; references: by gait and speed; far: bodies of the far side of the model.
    """

    tables: GridTables
    arrays: Mapping[str, NDArray[Any]]
    strides: RampStrides
    references: Mapping[tuple[str, float], CellReference]
    model: Any
    far: Collection[str]
    manifests: Mapping[str, Manifest]
    seed: int


def write_commands_page(path: Path, report: GridReport, *, film: str | None, files: Mapping[str, str]) -> None:
    """Write the page; film: name of the ramp's, None: there is none; files: what lies beside it, and what it is."""
    tables, dt = report.tables, float(report.arrays["dt"])
    cells = played_cells(report.arrays, report.references, report.model)
    table = cell_table(cells, tables.student)
    lines = gait_lines(table)
    numbers = {(cell.gait, cell.speed): number for number, cell in enumerate(cells)}
    measures = {name: label for name, label in GRID_MEASURES.items() if name in tables.grid}
    walkers = list(WALKER_ORDER)
    footfall = footfall_charts(lines, [cell.stretch for cell in cells], dt)
    sections: dict[str, Sequence[Chart]] = {
        "grid": grid_charts(tables, numbers),
        "footfall": [replace(chart, title=line.gait) for chart, line in zip(footfall, lines, strict=True)],
        "matrices": matrix_charts(tables),
        "ramp": ramp_charts(report.strides),
    }
    render_page(
        path,
        name="commands",
        scene=player_scene(report, cells, table, measures, walkers),
        sections=sections,
        title="One student for every speed",
        headline=grid_summary_text(tables, report.strides),
        setting=grid_setting(tables, report.seed),
        colors=COLORS,
        labels=WALKER_LABELS,
        short=GRID_LABELS,
        signs=GAIT_SIGNS,
        walkers=walkers,
        gaits=[line.gait for line in lines],
        measures=list(measures.values()),
        verdicts=verdicts(tables.summary),
        held_out=not tables.grid.taught.all(),
        cost_said=cost_said(tables),
        transitions=transition_table(tables.transitions),
        ramp_now=report.strides.upright > 1,
        ramp_said=ramp_said(report.strides),
        ramp_gaits=gaits_seen(report.strides),
        film=film,
        rows=number_rows(tables.grid, list(measures)),
        files=files,
        origin_rows=origins.origin_rows(report.manifests),
        versions=origins.version_rows(report.manifests),
        settings=origins.setting_rows(report.manifests),
        definitions=GRID_MEANINGS,
    )


def player_scene(
    report: GridReport,
    cells: Sequence[PlayedCell],
    table: pd.DataFrame,
    measures: Mapping[str, str],
    walkers: Sequence[str],
) -> dict[str, Any]:
    """What the player draws and says; the ramp as one walker more, as far as the student stands."""
    drawn, grid, upright = played_walkers(cells), report.tables.grid, report.strides.upright
    if upright > 1:
        drawn["ramp"] = ramp_walker(report, report.arrays["ramp_states"][:upright].astype(float))
    rows = {(row.walker, row.gait, row.speed_m_per_s): row for _, row in grid.iterrows()}
    told = []
    for cell in cells:
        own = [rows.get((walker, cell.gait, cell.speed)) for walker in walkers]
        student = rows.get(("student", cell.gait, cell.speed))
        told.append(
            {
                "asked": cell.speed,
                "goal": f"{cell.speed:g} m/s",
                "good": student is not None and bool(student.speed_held) and not student.falls,
                "said": f"{said_of_cell(student).capitalize()}." if student is not None else "",
                "numbers": [
                    ["-" if row is None else measured_text(name, float(row[name])) for row in own] for name in measures
                ],
                **cell.feet,
            }
        )
    parts = segments(report.model, report.far)
    return {
        "dt": float(report.arrays["dt"]),
        "top": round(max(LEAST_TOP, *(cell.top for cell in cells)), 3),
        "segments": [[round(part.radius, 4), int(part.far)] for part in parts],
        "walkers": drawn,
        "lines": [
            {"gait": line.gait, "share": line.share, "color": STUDENT, "cells": line.rows.index.tolist()}
            for line in gait_lines(table)
        ],
        "cells": told,
        "start": first_cell(table),
        "ramp_now": [report.strides.now(step) for step in range(upright)],
    }


def ramp_walker(report: GridReport, states: Floats) -> dict[str, Any]:
    """The ramp as the player draws it; states (T, nq or more)."""
    points, x = humanoid_points(report.model, states)
    return recording(points, x, report.arrays["ramp_contact"][: len(states)].astype(bool), [0, len(states) - 1])


def first_cell(table: pd.DataFrame) -> int:
    """The cell that is shown first: the middle one of those in which the student stands."""
    kept = table[table.fit] if table.fit.any() else table
    return int(kept.index[len(kept) // 2])


def number_rows(grid: pd.DataFrame, measures: Sequence[str]) -> list[list[str]]:
    """Every row of the grid as text: what is asked for, the walker, what is said of it, and its numbers."""
    found = []
    walked = grid[grid.walker.isin(WALKER_ORDER)]
    for _, row in walked.sort_values(["gait", "speed_m_per_s"], kind="stable").iterrows():
        said = said_of_cell(row) if row.walker == "student" else ""
        numbers = [measured_text(name, float(row[name])) for name in measures]
        found.append([f"{row.gait} {row.speed_m_per_s:g} m/s", str(row.walker), said, *numbers])
    return found
