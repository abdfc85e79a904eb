"""What a sweep leaves when it ends: jobs.csv, cells.csv, table.md and figures in its directory, from its artifacts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd

from romgrl.report.grid_tables import BARS
from romgrl.report.numbers import UNKNOWN, significant
from romgrl.report.tables import markdown
from romgrl.results.against_student import write_against_student
from romgrl.results.fall_rates import write_disturbances
from romgrl.results.seed_groups import seeds_told
from romgrl.results.statistics import Interval
from romgrl.results.sweep_cells import (
    SEED_KEY,
    JobResult,
    cells_table,
    headline_jobs,
    jobs_table,
    number_row,
    of_students,
    results,
)
from romgrl.results.sweep_cost import best_jobs, cost
from romgrl.results.sweep_record import RESULTS, UNFINISHED, Sweep
from romgrl.results.text_table import BRACKETS, with_interval, with_range

TABLE_FILE = "table.md"
TABLE_COLUMNS = {
    "average/aligned/reduction_percent": "reduction [%]",
    "weakest/aligned/reduction_percent": "weakest channel [%]",
    "student/error_over_variance": "error over variance",
    "average/aligned/student": "error, student [m²]",
    "average/aligned/baseline": "error, baseline [m²]",
    "average/raw/reduction_percent": "reduction, raw [%]",
    "student/falls_percent": "falls [%]",
    "student/steady_speed_m_per_s": "speed [m/s]",
    "student/stride_frequency_deviation_percent": "cadence off by [%]",
}
TEACHER_COLUMNS = {
    "teacher/falls_percent": "falls [%]",
    "teacher/steady_speed_m_per_s": "speed [m/s]",
    "teacher/stride_frequency_hz": "strides [Hz]",
    "teacher/duty_factor": "duty factor",
    "teacher/pelvis_excursion_m": "excursion [m]",
    "library/cells": "cells",
    "library/fit_percent": "fit cells [%]",
    "library/largest_multiplier": "largest multiplier",
}
DRAWN = {"student/falls_percent", "teacher/falls_percent"}


WALKED_COLUMNS = (
    "student/error_over_variance",
    "student/falls_percent",
    "student/steady_speed_m_per_s",
    "student/stride_frequency_deviation_percent",
)
"""Of TABLE_COLUMNS, those that need no baseline."""
BAR_COLUMNS = {f"grid/{name}/student": meaning for name, (_, _, meaning) in BARS.items()}


def write_joint(sweep: Sweep, outputs: Path) -> Path:
    """Write everything that the jobs of a sweep say together; returns the directory."""
    directory = sweep.directory / RESULTS
    found = results(sweep, outputs)
    table, _ = write_tables(sweep, found, outputs, directory)
    command = ["Started by", "", f"    {sweep.command}", ""]
    lines = [f"# {sweep.title}", "", *table, *failures(found), "", *best_jobs(found), ""]
    (directory / TABLE_FILE).write_text(
        "\n".join([*lines, *cost(sweep, found, outputs), "", *command]), encoding="utf-8"
    )
    return directory


def write_tables(sweep: Sweep, found: list[JobResult], outputs: Path, directory: Path) -> tuple[list[str], list[Path]]:
    """CSV files and figures; returns the text of the main table, and the paths without those of PDFs."""
    directory.mkdir(parents=True, exist_ok=True)
    jobs, cells = jobs_table(found), cells_table(found)
    jobs.to_csv(directory / "jobs.csv", index=False)
    if not cells.empty:
        cells.to_csv(directory / "cells.csv", index=False)
    if set(cells.get("number", ())) & DRAWN:
        drawn = headline_jobs(found)
        shown = cells if len(drawn) == sum(each.error is None for each in found) else cells_table(drawn)
        save_figures(shown, jobs_table(drawn), sweep.title, directory)
    text = write_disturbances(found, outputs, directory)
    if not text or any(each.evaluation for each in found):
        text += [*seeds_line(found), joint_table(cells)]
    text += write_against_student(sweep, found, directory)
    return text, [path for path in sorted(directory.iterdir()) if path.suffix in (".csv", ".png")]


def save_figures(cells: pd.DataFrame, jobs: pd.DataFrame, title: str, directory: Path) -> None:
    """Save the figures; matplotlib takes a second to import."""
    from romgrl.report.style import save
    from romgrl.results.sweep_figures import figures

    for name, figure in figures(cells, jobs, title).items():
        save(figure, directory, name)


def joint_table(cells: pd.DataFrame) -> str:
    """One row per cell and group of seeds: means of the main numbers with intervals or ranges, how surely the error is
    below the baseline's, seeds, what to know."""
    if cells.empty:
        return "No job has numbers to compare.\n"
    keys = [name for name in cells.columns[: list(cells.columns).index("number")] if name != SEED_KEY]
    others = {name: label for name, label in (TEACHER_COLUMNS | BAR_COLUMNS).items() if name in set(cells.number)}
    columns = TABLE_COLUMNS if of_students(cells) else others
    rows = []
    several = cells["group"].nunique() > 1
    for values, cell in cells.groupby([*keys, "group"], sort=False):
        by_number = cell.set_index("number")
        row: dict[str, Any] = dict(zip(keys, values[:-1], strict=True))
        row |= {"these seeds": values[-1]} if several else {}
        for measure, label in columns.items():
            row[label] = written(by_number.loc[measure]) if measure in by_number.index else UNKNOWN
        if "average/aligned/student" in by_number.index:
            errors: Any = by_number.loc["average/aligned/student"]
            row["P(better than baseline)"] = written(errors, "improvement")
            row["p, paired"] = significant(float(errors.get("paired_p", math.nan)))
        row |= {"seeds": int(cell["seeds"].max()), "note": cell["note"].iloc[0]}
        rows.append(row)
    return markdown(pd.DataFrame(rows))


def walked(cell: list[JobResult]) -> dict[str, str]:
    """How a cell's students walk, beside what errors say: WALKED_COLUMNS of its jobs."""
    rows = {name: number_row(cell, name, "") for name in WALKED_COLUMNS}
    return {TABLE_COLUMNS[name]: written(row) if row else UNKNOWN for name, row in rows.items()}


def written(row: Any, of: str = "mean") -> str:
    """`88.1 [86.8, 89.2]`, or a range in parentheses; a dash without a number."""
    if of not in row or not math.isfinite(row[of]):
        return UNKNOWN
    if of != "mean":
        return with_interval(row[of], Interval(row[f"{of}_low"], row[f"{of}_high"]))
    ends = Interval(row["low"], row["high"])
    return with_range(row["mean"], ends, row["smallest"], row["largest"], row["seeds"] - row["without"])


def seeds_line(found: list[JobResult]) -> list[str]:
    """Which seeds are held out, which chose the settings, and what brackets mean; nothing where there is no student."""
    seeds = [each.seed for each in found if each.seed is not None]
    return (
        [f"Student{'s' if len(seeds) > 1 else ''} of {seeds_told(seeds)}; {BRACKETS}; p: exact, one-sided.", ""]
        if seeds
        else []
    )


def failures(found: list[JobResult]) -> list[str]:
    """A line for each job that has no numbers, and one for all that did not end."""
    named = [
        (" ".join(f"{key}={value}" for key, value in each.swept.items()) or "job", each.error)
        for each in found
        if each.error is not None
    ]
    missing = [name for name, error in named if error == UNFINISHED]
    lines = [f"- {name}: {error}" for name, error in named if error != UNFINISHED]
    return [*lines, f"- {UNFINISHED}: {', '.join(missing)}"] if missing else lines
