"""An evaluation as the tables that end a run and as its numbers: of one speed, or over a grid of commands."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from romgrl.report.numbers import UNKNOWN, significant
from romgrl.report.terminal_tables import Rows, number, read_rows, result_metrics, result_tables

GRID_FILE = "grid.json"
BARS: dict[str, tuple[str, float, str]] = {
    "speed_held_percent": ("at least", 90.0, "cells whose speed is held within max(0.1 m/s, 5 %) [%]"),
    "most_falls_percent": ("at most", 1.0, "falls in the cell with the most [%]"),
    "error_over_specialist": ("at most", 1.5, "error over that of a student of one speed, largest"),
    "held_out_over_neighbours": ("at most", 1.3, "error at a speed that is not taught over its neighbours', largest"),
    "mmd_diagonal_percent": ("at least", 100.0, "cells whose nearest reference by MMD is their own [%]"),
    "gait_obeyed_percent": ("at least", 95.0, "episodes of the gait asked for, the gait with the fewest [%]"),
    "transition_falls_percent": ("at most", 2.0, "falls in the transition, or on the ramp, with the most [%]"),
    "cadence_spearman": ("at least", 0.95, "rank correlation of cadence and speed, the gait with the least"),
}
"""Of the student: which way, how much, of what."""
RAMP_NUMBERS = ("falls_percent", "speed_error_m_per_s", "switch_up_m_per_s", "switch_down_m_per_s")
SHOWN_CELLS = {
    "steady_speed_m_per_s": "speed\n[m/s]",
    "falls": "falls",
    "error_over_variance": "error over\nvariance",
    "stride_frequency_hz": "strides\n[Hz]",
    "duty_factor": "duty\nfactor",
    "cost_of_transport": "cost of\ntransport",
    "obeyed_gait": "gait\nobeyed",
}
"""Of the student, columns of grid.csv."""
SHOWN_TRANSITIONS = {
    "falls": "falls",
    "episodes": "of",
    "settled": "settled",
    "settling_time_s": "settling\n[s]",
    "overshoot_m_per_s": "overshoot\n[m/s]",
    "obeyed_gait": "gait\nobeyed",
}
OTHERS = {"baseline": "baseline", "teacher": "floor", "sinusoid": "sinusoid"}
"""Whose error over variance stands beside the student's."""
WALKER_ORDER = ("student", "baseline", "teacher")
GRID_LABELS = {"student": "student", "baseline": "baseline", "teacher": "reference"}
"""What they are called where people read: of the teachers, what counts is the references that are kept in a library."""
VERDICTS = {True: "reached", False: "missed", None: "not measured"}


def is_grid(evaluation: Path) -> bool:
    """Tell whether an evaluation is one over a grid of commands."""
    return (evaluation / GRID_FILE).is_file()


def evaluation_tables(evaluation: Path) -> list[Table]:
    """What ends a run."""
    if not is_grid(evaluation):
        return result_tables(evaluation)
    found = read_grid(evaluation)
    rows, steps = read_rows(evaluation / "grid.csv"), read_rows(evaluation / "transitions.csv")
    return [grid_cells_table(rows), transitions_table(steps), bars_table(found)]


def evaluation_metrics(evaluation: Path) -> dict[str, float]:
    """Numbers of a run: of a grid each bar's of student and baseline, as grid/speed_held_percent/student."""
    return grid_numbers(read_grid(evaluation)) if is_grid(evaluation) else result_metrics(evaluation)


def grid_names() -> list[str]:
    """The names of the numbers that an evaluation over a grid can have."""
    names = [*(f"grid/{name}" for name in BARS), *(f"grid/ramp_{name}" for name in RAMP_NUMBERS)]
    return ["grid/bars_reached", *(f"{name}/{walker}" for name in names for walker in WALKER_ORDER[:2])]


def read_grid(evaluation: Path) -> dict[str, Any]:
    """grid.json."""
    return dict(json.loads((evaluation / GRID_FILE).read_text(encoding="utf-8")))


def grid_numbers(found: Mapping[str, Any]) -> dict[str, float]:
    """Of grid.json."""
    numbers = {f"grid/{bar['name']}/{walker}": bar.get(walker) for bar in found["bars"] for walker in WALKER_ORDER[:2]}
    numbers |= {
        f"grid/ramp_{name}/{walker}": value for walker, ramp in found["ramp"].items() for name, value in ramp.items()
    }
    return {"grid/bars_reached": float(found["reached"])} | {
        name: float(value) for name, value in numbers.items() if value is not None
    }


def grid_cells_table(rows: Rows) -> Table:
    """One row per cell: the student's numbers, and errors of the others."""
    table = Table(title="Grid of commands, student", title_justify="left")
    table.add_column(escape("asked [m/s]"), no_wrap=True)
    for label in (*SHOWN_CELLS.values(), *(f"error of\n{label}" for label in OTHERS.values()), "over\nspecialist"):
        table.add_column(escape(label), justify="right")
    at = {(row["walker"], row["gait"], row["speed_m_per_s"]): row for row in rows}
    for (walker, gait, speed), row in at.items():
        if walker != "student":
            continue
        asked = f"{gait} {number(speed):g}" + ("" if row["taught"] == "True" else ", not taught")
        held = "" if row["speed_held"] == "True" else " *"
        values = [cell_text(row[name]) for name in SHOWN_CELLS]
        values[0] += held
        errors = [cell_text(at.get((other, gait, speed), {}).get("error_over_variance", "")) for other in OTHERS]
        table.add_row(asked, *values, *errors, cell_text(row["error_over_specialist"]))
    table.caption = (
        "*: not held within max(0.1 m/s, 5 %); floor: the reference against itself; a statue has an error of 1"
    )
    table.caption_justify = "left"
    return table


def transitions_table(rows: Rows) -> Table:
    """One row per transition and walker."""
    table = Table(title="Transitions", title_justify="left")
    for label in ("from one to the other [m/s]", "walker"):
        table.add_column(escape(label), no_wrap=True)
    for label in SHOWN_TRANSITIONS.values():
        table.add_column(escape(label), justify="right")
    for row in rows:
        table.add_row(row["transition"], row["walker"], *(cell_text(row[name]) for name in SHOWN_TRANSITIONS))
    return table


def bars_table(found: Mapping[str, Any]) -> Table:
    """One row per bar; below what the ramp came to, and the bars_verdict."""
    table = Table(title="What a student of every speed is asked for", title_justify="left")
    table.add_column("number")
    for label in GRID_LABELS.values():
        table.add_column(escape(label), justify="right")
    table.add_column("bar", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for bar in found["bars"]:
        values = [known_text(bar.get(walker)) for walker in WALKER_ORDER]
        table.add_row(bar["meaning"], *values, f"{bar['way']} {bar['bar']:g}", VERDICTS[bar["reached"]])
    table.caption = "\n".join((ramp_text(found), bars_verdict(found)))
    table.caption_justify = "left"
    return table


def ramp_text(found: Mapping[str, Any]) -> str:
    """Of the student on the ramp, in words."""
    ramp = found["ramp"]["student"]
    told = f"ramp: off by {known_text(ramp['speed_error_m_per_s'])} m/s, {ramp['falls_percent']:.0f} % fall"
    if len(found["ramp_gaits"]) < 2:
        return told
    low, high = found["human_switch_m_per_s"]
    up, down = (known_text(ramp[f"switch_{way}_m_per_s"]) for way in ("up", "down"))
    return f"{told}; left to choose, runs from {up} m/s on and walks below {down} (people: {low:g} to {high:g})"


def bars_verdict(found: Mapping[str, Any]) -> str:
    """One line."""
    lacking = [
        f"{label}: {', '.join(found[key])}"
        for key, label in (("missed", "missed"), ("not_measured", "not measured"))
        if found[key]
    ]
    return f"{found['reached']} of {len(found['bars'])} bars reached" + "".join(f"; {each}" for each in lacking)


def cell_text(cell: str) -> str:
    """A number of a CSV file to three significant digits."""
    return significant(number(cell))


def known_text(value: float | None) -> str:
    """The same of a number, or a dash."""
    return UNKNOWN if value is None else significant(value if math.isfinite(value) else math.nan)
