"""report.md of a student that follows commands: what it does at each speed, in words and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from romgrl.gait.measures import MEASURES
from romgrl.report.command_grid import ERROR, GRID_MEASURES, GridTables, Verdict, measured_text, verdicts
from romgrl.report.cost_over_speed import cost_over_speed
from romgrl.report.grid_tables import GRID_LABELS
from romgrl.report.numbers import significant
from romgrl.report.ramp_strides import RampStrides
from romgrl.report.tables import definitions, markdown

GRID_MEANINGS = {
    "speed held": "the steady speed is within 0.1 m/s of the one that is asked for, or 5 % where that is more",
    "never taught": "a cell of the library that the student was not shown (student.taught_step)",
    "distance (MMD²)": "maximum mean discrepancy, squared, between the student at one command and the reference of "
    "each; below zero is drawn as 0",
    "gait of a stride (ramp)": "of the left foot: a hop or a skip where the right foot lands as in these, else a run "
    "where a foot is on the ground for less than half of the stride, and a walk where it is not",
    "falls": "episodes that end before their time",
    **{MEASURES[name].label: why for name in GRID_MEASURES if name in MEASURES and (why := MEASURES[name].meaning)},
}
FEWEST_COSTS = 3
TRANSITION_LABELS = {
    "transition": "transition",
    "walker": "walker",
    "episodes": "episodes",
    "falls": "falls",
    "settled": "settled",
    "settling_time_s": "settling time [s]",
    "overshoot_m_per_s": "overshoot [m/s]",
    "obeyed_gait": "share of the gait asked for",
}


def grid_summary_text(tables: GridTables, strides: RampStrides) -> str:
    """The result in two sentences."""
    rows = tables.student
    held, falls = int(rows.speed_held.astype(bool).sum()), int(rows.falls.sum())
    errors = rows[ERROR][np.isfinite(rows[ERROR])]
    near = f", error over variance {significant(float(errors.median()))} in the middle" if len(errors) else ""
    speeds = f"{rows.speed_m_per_s.min():g} to {rows.speed_m_per_s.max():g} m/s"
    return (
        f"One policy at {speeds} ({', '.join(sorted(set(rows.gait)))}): speed held in {held} of {len(rows)} cells, "
        f"{falls} of {rows.episodes.sum():.0f} episodes fall{near}. {ramp_said(strides)}"
    )


def grid_setting(tables: GridTables, seed: int) -> str:
    """How it was measured."""
    taught = int(tables.student.taught.sum())
    return (
        f"{tables.student.episodes.median():.0f} episodes of each of {len(tables.student)} cells, of which {taught} "
        f"were taught; seed {seed}, one training: another seed gives other numbers."
    )


def ramp_said(strides: RampStrides) -> str:
    """How the ramp went."""
    top, end = float(strides.asked.max()), float(strides.time[-1])
    asked = f"Asked from {strides.asked[0]:g} to {top:g} and back to {strides.asked[-1]:.2g} m/s in {end:.0f} s, it"
    if strides.fell:
        at = strides.time[strides.upright]
        return f"{asked} fell after {at:.1f} s, at {strides.asked[strides.upright]:.2f} m/s."
    off = float(np.sqrt(np.mean((strides.held - strides.asked) ** 2)))
    shown = list(dict.fromkeys(strides.gaits))
    return f"{asked} stayed upright, {off:.2f} m/s off (root mean square); strides of a {' and a '.join(shown)}."


def cost_said(tables: GridTables) -> str:
    """Whether the cost of transport of each gait is a U over speed."""
    said = [cost_of_gait(str(gait), rows) for gait, rows in tables.student.groupby("gait")]
    return " ".join(text for text in said if text)


def cost_of_gait(gait: str, rows: pd.DataFrame) -> str:
    """In a sentence; nothing where too few cells count."""
    speeds, costs = cost = cost_over_speed(rows)
    if len(costs) < FEWEST_COSTS:
        return ""
    ends = [100.0 * (costs[end] / costs[cost.cheapest] - 1.0) for end in (0, -1)]
    return (
        f"Cost of transport of its {gait}: {'a' if cost.is_u else 'no'} U over speed, least at "
        f"{speeds[cost.cheapest]:g} m/s, {ends[0]:.0f} % more at {speeds[0]:g} and {ends[1]:.0f} % more at "
        f"{speeds[-1]:g} m/s."
    )


def transition_table(transitions: pd.DataFrame) -> pd.DataFrame:
    """transitions.csv for reading, the walkers of each transition below one another."""
    order = dict.fromkeys(transitions.transition)
    rows = pd.concat([transitions[transitions.transition == name] for name in order])
    shown = pd.DataFrame({label: rows[name] for name, label in TRANSITION_LABELS.items() if name in rows})
    for name in shown:
        if shown[name].dtype.kind in "fiu":
            shown[name] = [significant(float(value)) for value in shown[name]]
    return shown


def verdict_table(found: Sequence[Verdict]) -> pd.DataFrame:
    """Verdicts for reading."""
    rows = [(each.question, each.bar, *each.values, each.mark) for each in found]
    return pd.DataFrame(rows, columns=["of the student", "bar", *GRID_LABELS.values(), "verdict"])


def grid_numbers_table(student: pd.DataFrame) -> pd.DataFrame:
    """The student's rows of the grid for reading."""
    shown = {name: label for name, label in GRID_MEASURES.items() if name in student}
    asked = [f"{row.gait} {row.speed_m_per_s:g}" for _, row in student.iterrows()]
    table = pd.DataFrame({"asked [m/s]": asked, "taught": ["yes" if each else "no" for each in student.taught]})
    for name, label in shown.items():
        table[label] = [measured_text(name, float(value)) for value in student[name]]
    return table


def grid_document(
    tables: GridTables,
    strides: RampStrides,
    *,
    seed: int,
    pictures: Sequence[str],
    films: Sequence[str],
    wall_times: Mapping[str, float],
) -> str:
    """report.md; pictures and films are names of files beside it."""
    parts = [
        f"# One student for every speed\n\n{grid_summary_text(tables, strides)}\n",
        grid_setting(tables, seed) + "\n",
        f"## Verdicts\n\n{markdown(verdict_table(verdicts(tables.summary)))}",
        f"## Over the speeds\n\n{cost_said(tables)}\n\n{markdown(grid_numbers_table(tables.student))}",
        f"## From one command to another\n\n{markdown(transition_table(tables.transitions))}",
        "## Pictures\n\n" + "\n\n".join(f"![{name}]({name}.png)" for name in pictures) + "\n",
    ]
    if films:
        parts.append("## Films\n\n" + "\n".join(f"- [{name}]({name})" for name in films) + "\n")
    parts.append(f"## How the numbers were obtained\n\n{definitions(GRID_MEANINGS)}")
    times = pd.DataFrame({"stage": list(wall_times), "wall time [s]": list(wall_times.values())})
    parts.append(f"## Time\n\n{markdown(times)}")
    return "\n".join(parts)
