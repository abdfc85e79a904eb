"""What an evaluation over the grid of commands comes to: each bar, and whether it is reached."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from romgrl.gait.command_following import switching_speed
from romgrl.gait.features import Floats
from romgrl.report.cost_over_speed import cost_over_speed
from romgrl.report.grid_tables import BARS
from romgrl.report.specialists import SPEED_DIGITS, Specialist
from romgrl.stages.conditioned.grid_cells import GridCells
from romgrl.stages.conditioned.transitions import Ramp

HUMAN_SWITCH = (1.9, 3.0)
"""m/s: where people change from walk to run and back (arXiv 2501.00720)."""
WalkerNumbers = dict[str, float]


def grid_results(
    grid: GridCells,
    table: pd.DataFrame,
    mmd: Mapping[str, Floats],
    transitions: pd.DataFrame,
    ramp: pd.DataFrame,
    asked: Ramp,
) -> dict[str, Any]:
    """Of grid.json: bars, what student, baseline and reference come to, ramp and cost of transport.

    mmd: matrices (C, C) of the walkers that have one.
    """
    found: dict[str, WalkerNumbers] = {}
    for name, rows in table.groupby("walker", sort=False):
        if name in ("student", "baseline", "teacher"):
            found[str(name)] = cell_numbers(rows)
    for name in ("student", "baseline"):
        falls = [fall_percent(rows) for _, rows in transitions[transitions.walker == name].iterrows()]
        falls.append(ramp_falls(ramp[ramp.walker == name]))
        found[name]["transition_falls_percent"] = max(falls)
    for name, matrix in mmd.items():
        found[name]["mmd_diagonal_percent"] = diagonal_percent(matrix)
    bars = [bar(name, found) for name in BARS]
    missed = [each["name"] for each in bars if each["reached"] is False]
    unknown = [each["name"] for each in bars if each["reached"] is None]
    return {
        "cells": grid.count,
        "episodes": int(table[table.walker == "student"].episodes.iloc[0]),
        "window": grid.window,
        "bars": bars,
        "reached": len(bars) - len(missed) - len(unknown),
        "missed": missed,
        "not_measured": unknown,
        "ramp": {name: ramp_numbers(ramp[ramp.walker == name], asked) for name in ("student", "baseline")},
        "ramp_gaits": list(asked.gaits),
        "human_switch_m_per_s": list(HUMAN_SWITCH),
        "cost_of_transport": {name: cheapest_speeds(table[table.walker == name]) for name in ("student", "teacher")},
    }


def cell_numbers(rows: pd.DataFrame) -> WalkerNumbers:
    """Of a walker's rows of grid.csv."""
    obeyed = rows.groupby("gait").obeyed_gait.mean()
    return {
        "speed_held_percent": 100.0 * float(rows.speed_held.astype(float).mean()),
        "most_falls_percent": float((100.0 * rows.falls / rows.episodes).max()),
        "error_over_specialist": largest(rows.error_over_specialist),
        "held_out_over_neighbours": held_out_ratio(rows),
        "gait_obeyed_percent": 100.0 * float(obeyed.min()),
        "cadence_spearman": least_spearman(rows, "stride_frequency_hz"),
    }


def bar(name: str, found: Mapping[str, WalkerNumbers]) -> dict[str, Any]:
    """One bar beside what walkers come to; reached: None where the student's number is not known."""
    way, limit, meaning = BARS[name]
    value = found["student"].get(name, math.nan)
    reached = None if math.isnan(value) else bool(value >= limit if way == "at least" else value <= limit)
    others = {walker: known(numbers.get(name, math.nan)) for walker, numbers in found.items()}
    return {"name": name, "meaning": meaning, "way": way, "bar": limit, "reached": reached, **others}


def known(value: float) -> float | None:
    """A number as JSON has it: None where it is not known."""
    return float(value) if math.isfinite(value) else None


def largest(values: pd.Series) -> float:
    """Of those that are known."""
    return float(values.max()) if values.notna().any() else math.nan


def fall_percent(row: pd.Series) -> float:
    """Of a row of transitions.csv."""
    return 100.0 * float(row.falls) / float(row.episodes)


def ramp_falls(rows: pd.DataFrame) -> float:
    """Percent of the episodes of a walker's ramp that fall: the first bin is begun by all of them."""
    begun = float(rows.episodes.iloc[0] + rows.falls.iloc[0])
    return 100.0 * float(rows.falls.sum()) / begun


def held_out_ratio(rows: pd.DataFrame) -> float:
    """The largest error of a cell that is not taught over the mean of the taught ones next to it; nan without any, inf
    where it or one next to it has no error, since all its episodes fall."""
    ratios = []
    for _, own in rows.groupby("gait"):
        ordered = own.sort_values("speed_m_per_s")
        taught = ordered[ordered.taught.astype(bool)]
        for _, row in ordered[~ordered.taught.astype(bool)].iterrows():
            near = [taught[taught.speed_m_per_s < row.speed_m_per_s].tail(1)]
            near.append(taught[taught.speed_m_per_s > row.speed_m_per_s].head(1))
            ratio = float(row.error_over_variance / pd.concat(near).error_over_variance.mean(skipna=False))
            ratios.append(ratio if math.isfinite(ratio) else math.inf)
    return max(ratios, default=math.nan)


def least_spearman(rows: pd.DataFrame, column: str) -> float:
    """Rank correlation of a column with speed, the least of the gaits that have three known cells and more; 0 of one
    that is the same in all."""
    found = []
    for _, own in rows.groupby("gait"):
        there = own[own[column].notna()]
        if len(there) > 2:
            varies = there[column].nunique() > 1
            found.append(float(spearmanr(there.speed_m_per_s, there[column]).statistic) if varies else 0.0)
    return min(found) if found else math.nan


def diagonal_percent(mmd: Floats) -> float:
    """Share of rows (C, C) whose smallest number is the diagonal's; a row that is not known does not count as such."""
    right = [int(np.nanargmin(row)) == number for number, row in enumerate(mmd) if np.isfinite(row).any()]
    return 100.0 * sum(right) / len(mmd)


def ramp_numbers(rows: pd.DataFrame, asked: Ramp) -> dict[str, float | None]:
    """Of a walker's rows of ramp.csv: mean distance from the speed asked for, falls, and where duty crosses 0.5."""
    found = {"falls_percent": ramp_falls(rows), "speed_error_m_per_s": float(rows.speed_error_m_per_s.abs().mean())}
    for direction, part in rows.groupby("direction"):
        at = switching_speed(part.asked_m_per_s.to_numpy(float), part.duty_factor.to_numpy(float))
        found[f"switch_{direction}_m_per_s"] = at if asked.auto else math.nan
    return {name: known(value) for name, value in found.items()}


def cheapest_speeds(rows: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Of each gait the speed of the least cost of transport, and whether it costs more at both ends: a U."""
    found = {}
    for gait, own in rows.groupby("gait"):
        cost = cost_over_speed(own)
        if len(cost.costs):
            least, at = float(cost.costs[cost.cheapest]), float(cost.speeds[cost.cheapest])
            found[str(gait)] = {"least": least, "at_m_per_s": at, "is_u": cost.is_u}
    return found


def specialist_numbers(specialists: Sequence[Specialist]) -> list[dict[str, Any]]:
    """As grid.json has them: one that falls in all its episodes has no error."""
    entries = [each._asdict() for each in specialists]
    return [{name: known(v) if isinstance(v, float) else v for name, v in entry.items()} for entry in entries]


def with_specialists(table: pd.DataFrame, specialists: Sequence[Specialist]) -> pd.DataFrame:
    """The same with `error_over_specialist` at the cells of specialists that have an error; inf where a walker falls in
    all its episodes, and has none."""
    table = table.copy()
    for each in specialists:
        same = (table.gait == each.gait) & (table.speed_m_per_s.round(SPEED_DIGITS) == round(each.speed, SPEED_DIGITS))
        mine = same & table.walker.isin(("student", "baseline"))
        if each.error > 0:
            over = table.loc[mine, "error_over_variance"] / each.error
            table.loc[mine, "error_over_specialist"] = over.fillna(math.inf)
    return table
