"""The results of an evaluation as the tables that end a run, and as numbers that runs are compared by."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from romgrl.gait.features import ALIGNMENTS, ALL, CHANNELS
from romgrl.gait.measures import MEASURES
from romgrl.provenance.stage_graph import STAGES
from romgrl.report.numbers import UNKNOWN, measured, significant

Rows = list[dict[str, str]]
TOGETHER = ("distances.csv", "null_models.csv")  # of which only what all channels come to together is a number of a run
DISTANCES_SHOWN = ("baseline", "student", "teacher_floor", "baseline_p", "student_p")
GROWING = ("push_forward", "push_backward", "observation_noise")
HALF = 0.5
HEADLINE = {
    "01_reduction_percent": "average/aligned/reduction_percent",
    "02_weakest_reduction_percent": "weakest/aligned/reduction_percent",
    "03_error_student": "average/aligned/student",
    "04_error_baseline": "average/aligned/baseline",
    "05_falls_percent": "student/falls_percent",
    "06_speed_m_per_s": "student/steady_speed_m_per_s",
    "07_stride_frequency_hz": "student/stride_frequency_hz",
    "08_duty_factor": "student/duty_factor",
    "09_trunk_lean_deg": "student/trunk_lean_deg",
}  # numbers that matter most, and the names under which MLflow shows them before all others
TRAINING_MINUTES = "10_training_minutes"
ERRORS_SHOWN = ("baseline", "student", "reduction_percent")


def result_tables(evaluation: Path) -> list[Table]:
    """Tables of errors, distances and gaits; none where the evaluation has no such file."""
    makers = {
        "mse.csv": terminal_error_table,
        "distances.csv": terminal_distance_table,
        "gait.csv": terminal_gait_table,
    }
    found = {name: read_rows(evaluation / name) for name in makers}
    return [makers[name](rows) for name, rows in found.items() if rows]


def result_metrics(evaluation: Path) -> dict[str, float]:
    """Every finite number of errors and gaits, and the distances and null models of all channels together.

    Named pelvis_y/aligned/student, mmd/all/student_p, student/mean_speed_m_per_s, mmd/all/statue and so on.
    """
    metrics: dict[str, float] = {}
    for name, names in STAGES["evaluation"].tables.items():
        for row in read_rows(evaluation / name):
            if name in TOGETHER and row["channel"] in CHANNELS:
                continue
            prefix = "/".join(row.pop(column) for column in names)
            named = {"value": prefix} | {column: f"{prefix}/{column}" for column in row if column != "value"}
            metrics |= {named[column]: number(cell) for column, cell in row.items() if column != "unit"}
    return {name: value for name, value in metrics.items() if math.isfinite(value)}


def headline(numbers: Mapping[str, float]) -> dict[str, float]:
    """The numbers of an evaluation that matter most, by the names that bring them to the front."""
    known = with_weakest(with_falls(dict(numbers)))
    return {name: known[source] for name, source in HEADLINE.items() if source in known}


def with_falls(numbers: dict[str, float]) -> dict[str, float]:
    """Numbers with the share of episodes that ended in a fall."""
    for name in [name for name in numbers if name.endswith("/falls")]:
        walker = name.removesuffix("/falls")
        episodes = numbers.get(f"{walker}/episodes", math.nan)
        if episodes > 0 and math.isfinite(numbers[name]):
            numbers = numbers | {f"{walker}/falls_percent": 100.0 * numbers[name] / episodes}
    return numbers


def with_weakest(numbers: dict[str, float]) -> dict[str, float]:
    """Numbers with the reduction of the channel that has least, where all channels have one."""
    reductions = [numbers.get(f"{channel}/aligned/reduction_percent", math.nan) for channel in CHANNELS]
    weakest = {"weakest/aligned/reduction_percent": min(reductions)} if all(map(math.isfinite, reductions)) else {}
    return numbers | weakest


def robustness_metrics(robustness: Path) -> dict[str, float]:
    """Fall rates as push_forward/0.3/student/fall_rate and so on, and push_forward/student/survived: the highest level
    at which, as at all levels below it, less than half of the trials fall, where there is one. teacher/multiplier: the
    largest, measured over the most strides, and its interval teacher/multiplier_low, teacher/multiplier_high."""
    metrics: dict[str, float] = {}
    lost: set[str] = set()
    for row in read_rows(robustness / "robustness.csv"):  # levels rise
        level, rate = number(row["level"]), number(row["fall_rate"])
        metrics[f"{row['perturbation']}/{level:g}/{row['walker']}/fall_rate"] = rate
        name = f"{row['perturbation']}/{row['walker']}/survived"
        if row["perturbation"] in GROWING and rate >= HALF:
            lost.add(name)
        elif row["perturbation"] in GROWING and name not in lost:
            metrics[name] = level
    largest = [row for row in read_rows(robustness / "floquet.csv") if row["rank"] == "1"][-1:]
    numbers = {"multiplier": "modulus", "multiplier_low": "low", "multiplier_high": "high"}
    metrics |= {f"teacher/{name}": number(row[column]) for row in largest for name, column in numbers.items()}
    return {name: value for name, value in metrics.items() if math.isfinite(value)}


def run_link(text: str, run_id: str | None) -> str:
    """A link to a run in the UI of MLflow, in Markdown; plain text where the run was not tracked."""
    return f"[{text}](#/runs/{run_id})" if run_id else text


def read_rows(path: Path) -> Rows:
    """The rows of a CSV file, none if there is no file."""
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines())) if path.is_file() else []


def terminal_error_table(rows: Rows) -> Table:
    """One row per channel: baseline, student and reduction by alignment; below what these are, and notes."""
    notes = dict.fromkeys(row["note"] for row in rows if row.get("note", "ok") != "ok")
    shown = [alignment for alignment in ALIGNMENTS if any(row["alignment"] == alignment for row in rows)]
    caption = "\n".join((", ".join(f"{each.replace('_', ' ')}: {ALIGNMENTS[each]}" for each in shown), *notes))
    table = Table(title="Error against the reference (m^2)", title_justify="left", caption=caption)
    table.add_column("channel", no_wrap=True)
    for alignment in shown:
        for column in ERRORS_SHOWN:
            header = f"{alignment}\n{column.replace('reduction_percent', 'reduction %')}"
            table.add_column(header.replace("_", " "), justify="right")
    cells = {(row["channel"], row["alignment"]): [short(row[column]) for column in ERRORS_SHOWN] for row in rows}
    for channel in dict.fromkeys(row["channel"] for row in rows):
        found = [cells.get((channel, alignment), [""] * len(ERRORS_SHOWN)) for alignment in shown]
        table.add_row(channel, *(cell for several in found for cell in several))
    return table


def terminal_distance_table(rows: Rows) -> Table:
    """One row per distance, all channels together."""
    table = Table(title="Distance from the reference", title_justify="left")
    table.add_column("distance", no_wrap=True)
    for column in (*DISTANCES_SHOWN, "unit"):
        table.add_column(column.replace("_", "\n"), justify="right")
    for row in rows:
        if row["channel"] == ALL:
            table.add_row(row["distance"], *(short(row[column]) for column in (*DISTANCES_SHOWN, "unit")))
    return table


def terminal_gait_table(rows: Rows) -> Table:
    """One column per walker, one row per number."""
    table = Table(title="Gait", title_justify="left")
    table.add_column("")
    for row in rows:
        table.add_column(row["walker"], justify="right")
    for column in rows[0]:
        if column != "walker":
            table.add_row(escape(MEASURES[column].title), *(measured(column, number(row[column])) for row in rows))
    return table


def number(cell: str) -> float:
    """The number in a cell; nan for text and for nothing."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def short(cell: str) -> str:
    """A number to three significant digits; a dash for none."""
    value = number(cell)
    return significant(value) if math.isfinite(value) else cell or UNKNOWN
