"""What a sweep leaves when it ends: jobs.csv, cells.csv, table.md and figures in its directory, from its artifacts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd

from romgrl.report.numbers import significant
from romgrl.report.tables import markdown
from romgrl.results.fall_rates import write_disturbances
from romgrl.results.sweep_cells import SEED_KEY, JobResult, cells_table, jobs_table, of_students, results
from romgrl.results.sweep_cost import best_jobs, cost
from romgrl.results.sweep_record import RESULTS, Sweep

TABLE_FILE = "table.md"
TABLE_COLUMNS = {
    "average/aligned/reduction_percent": "reduction [%]",
    "weakest/aligned/reduction_percent": "weakest channel [%]",
    "student/error_over_variance": "error over variance",
    "average/aligned/student": "error, ROM-GRL [m²]",
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
}
DRAWN = {"student/falls_percent", "teacher/falls_percent"}


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
    cells.to_csv(directory / "cells.csv", index=False)
    if set(cells.get("number", ())) & DRAWN:
        save_figures(cells, jobs, sweep.title, directory)
    text = write_disturbances(found, outputs, directory) or [joint_table(cells)]
    return text, [path for path in sorted(directory.iterdir()) if path.suffix in (".csv", ".png")]


def save_figures(cells: pd.DataFrame, jobs: pd.DataFrame, title: str, directory: Path) -> None:
    """Save the figures; matplotlib takes a second to import."""
    from romgrl.report.style import save
    from romgrl.results.sweep_figures import figures

    for name, figure in figures(cells, jobs, title).items():
        save(figure, directory, name)


def joint_table(cells: pd.DataFrame) -> str:
    """One row per cell: mean [95% interval] of the main numbers, probability of improvement, seeds, what to know."""
    if cells.empty:
        return "No job has numbers to compare.\n"
    keys = [name for name in cells.columns[: list(cells.columns).index("number")] if name != SEED_KEY]
    columns = TABLE_COLUMNS if of_students(cells) else TEACHER_COLUMNS
    rows = []
    for values, cell in cells.groupby(keys, sort=False) if keys else [((), cells)]:
        by_number = cell.set_index("number")
        row: dict[str, Any] = dict(zip(keys, values, strict=True))
        for measure, label in columns.items():
            row[label] = written(by_number.loc[measure]) if measure in by_number.index else "-"
        if "average/aligned/student" in by_number.index:
            row["P(better than baseline)"] = written(by_number.loc["average/aligned/student"], "improvement")
        row |= {"seeds": int(cell["seeds"].max()), "note": cell["note"].iloc[0]}
        rows.append(row)
    return markdown(pd.DataFrame(rows))


def written(row: Any, of: str = "mean") -> str:
    """`88.1 [86.8, 89.2]`; no brackets without an interval, a dash without a number."""
    low, high = ("low", "high") if of == "mean" else (f"{of}_low", f"{of}_high")
    if of not in row or not math.isfinite(row[of]):
        return "-"
    interval = f" [{significant(row[low])}, {significant(row[high])}]" if math.isfinite(row[low]) else ""
    return significant(row[of]) + interval


def failures(found: list[JobResult]) -> list[str]:
    """A line for each job that has no numbers."""
    return [
        f"- {' '.join(f'{key}={value}' for key, value in each.swept.items()) or 'job'}: {each.error}"
        for each in found
        if each.error is not None
    ]
