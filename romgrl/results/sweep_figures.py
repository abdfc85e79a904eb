"""Figures of a sweep: numbers against each swept key with bootstrap intervals or ranges over seeds, and maps of two."""

from __future__ import annotations

import math
from itertools import combinations, product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romgrl.gait.measures import MEASURES
from romgrl.report.numbers import significant
from romgrl.report.style import BASELINE, INK, STUDENT, TEACHER, dress, new_figure
from romgrl.results.statistics import FEWEST_SEEDS
from romgrl.results.sweep_cells import SEED_KEY, of_students

Keys = tuple[str, ...]

OVER_VARIANCE_PANEL = "error over variance (a statue has 1)"  # of some walkers a hundred times that of others
SWEEP_PANELS = {
    OVER_VARIANCE_PANEL: {"student": "student/error_over_variance", "baseline": "baseline/error_over_variance"},
    "reduction of the aligned error [%]": {"average": "average/aligned/reduction_percent"},
    "aligned error, average [m²]": {"student": "average/aligned/student", "baseline": "average/aligned/baseline"},
    "episodes with a fall [%]": {"student": "student/falls_percent", "baseline": "baseline/falls_percent"},
    "steady speed [m/s]": {"student": "student/steady_speed_m_per_s", "baseline": "baseline/steady_speed_m_per_s"},
    "strides [Hz]": {
        "teacher": "teacher/stride_frequency_hz",
        "student": "student/stride_frequency_hz",
        "baseline": "baseline/stride_frequency_hz",
    },
    "reduction of the weakest channel [%]": {"weakest": "weakest/aligned/reduction_percent"},
    "distance from the teacher (MMD)": {"student": "mmd/all/student", "baseline": "mmd/all/baseline"},
    "trunk lean [deg]": {"student": "student/trunk_lean_deg", "baseline": "baseline/trunk_lean_deg"},
}  # of those with numbers the first six are drawn
TEACHER_PANELS = {
    "episodes with a fall [%]": {"teacher": "teacher/falls_percent"},
    "steady speed [m/s]": {"teacher": "teacher/steady_speed_m_per_s"},
    "strides [Hz]": {"teacher": "teacher/stride_frequency_hz"},
    "duty factor": {"teacher": "teacher/duty_factor"},
    "excursion of the body [m]": {"teacher": "teacher/pelvis_excursion_m"},
    "symmetry": {"teacher": "teacher/left_right_symmetry"},
}
MAPS: Keys = (
    "average/aligned/reduction_percent",
    "weakest/aligned/reduction_percent",
    "student/falls_percent",
    "average/aligned/student",
    "student/steady_speed_m_per_s",
)  # of those with numbers the first three
TEACHER_MAPS: Keys = ("teacher/falls_percent", "teacher/speed_error_percent", "teacher/duty_factor")
LINE_COLORS = {"student": STUDENT, "baseline": BASELINE, "teacher": TEACHER, "average": STUDENT, "weakest": STUDENT}
LINES = {"student": "-", "average": "-", "weakest": "-", "baseline": "--", "teacher": ":"}
MOST_LINES = 6  # of combinations of the other keys in one panel; of more, only points are drawn


def figures(cells: pd.DataFrame, jobs: pd.DataFrame, title: str) -> dict[str, Figure]:
    """Figures by name: `by_eta` for every swept key, `map_eta_noise` for every two of them."""
    if cells.empty:
        return {}
    keys = [name for name in cells.columns[: list(cells.columns).index("number")] if name != SEED_KEY]
    numbers = set(cells["number"])
    wanted, mapped = (SWEEP_PANELS, MAPS) if of_students(cells) else (TEACHER_PANELS, TEACHER_MAPS)
    panels = dict([(label, of) for label, of in wanted.items() if numbers & {*of.values()}][: len(TEACHER_PANELS)])
    maps = tuple(measure for measure in mapped if measure in numbers)[: len(TEACHER_MAPS)]
    found = {f"by_{plain(key)}": against(key, keys, cells, jobs, panels, title) for key in keys}
    for pair in combinations(keys, 2):
        found[f"map_{plain(pair[0])}_{plain(pair[1])}"] = heat_maps(pair, cells, maps, title)
    return found


def plain(key: str) -> str:
    """A key as part of the name of a file."""
    return key.replace(".", "_").replace("/", "_")


def numeric(values: pd.Series) -> bool:
    """Tell whether all values of a key are numbers."""
    return bool(pd.to_numeric(values, errors="coerce").notna().all())


def ordered(values: pd.Series) -> list[str]:
    """The values of a key, numbers by size, names in the order of the sweep."""
    found = list(dict.fromkeys(values))
    return sorted(found, key=float) if numeric(values) else found


def against(
    key: str, keys: list[str], cells: pd.DataFrame, jobs: pd.DataFrame, panels: dict[str, dict[str, str]], title: str
) -> Figure:
    """Numbers against one key: mean with 95% interval or range, seeds as dots; a line for each value of the others."""
    figure = new_figure(11.0, 6.4)
    plots = figure.subplots(2, 3).ravel()
    others = [name for name in keys if name != key]
    values = ordered(cells[key])
    places = dict(zip(values, map(float, values) if numeric(cells[key]) else range(len(values)), strict=True))
    found = list(dict.fromkeys(cells[others].itertuples(index=False, name=None)))
    lines: list[Keys] = found if len(found) <= MOST_LINES else [()]
    for spare in plots[len(panels) :]:
        spare.set_visible(False)
    for axes, (label, measures) in zip(plots, panels.items(), strict=False):
        dress(axes, title=label, xlabel=key)
        axes.set_yscale("log" if label == OVER_VARIANCE_PANEL else "linear")
        for (who, measure), (index, line) in product(measures.items(), enumerate(lines)):
            chosen = dict(zip(others, line, strict=False))
            several = len(lines) > 1
            color = colormaps["viridis"](index / (len(lines) - 1) * 0.85) if several else LINE_COLORS[who]
            style = LINES[who] if len(lines) == len(found) and numeric(cells[key]) else ""
            offset = (index - (len(lines) - 1) / 2) * 0.012 * spread([*places.values()])
            name = ", ".join(f"{other}={value}" for other, value in chosen.items()) if several else who
            name = name if axes is plots[0] or not several else ""
            draw_line(axes, pick(cells, chosen), pick(jobs, chosen), key, measure, places, offset, color, style, name)
        if not numeric(cells[key]):
            axes.set_xticks([*places.values()], values, rotation=30, ha="right")
        if axes.get_legend_handles_labels()[1] and (len(measures) > 1 or len(lines) > 1):
            axes.legend(fontsize=7, frameon=False)
    styles = "; student solid, baseline dashed, teacher dotted" if len(lines) > 1 else ""
    more = f"; the {len(found)} combinations of {', '.join(others)} together" if len(lines) < len(found) else ""
    heading(figure, f"{title}: {note_of(cells)}{styles}{more}")
    return figure


def spread(places: list[float]) -> float:
    """Width of the axis of a key; 1 where it has one value."""
    return float(np.ptp(places)) or 1.0


def pick(table: pd.DataFrame, chosen: dict[str, str]) -> pd.DataFrame:
    """The rows with these values."""
    for name, value in chosen.items():
        table = table[table[name] == value]
    return table


def draw_line(
    axes: Axes,
    cells: pd.DataFrame,
    jobs: pd.DataFrame,
    key: str,
    measure: str,
    places: dict[str, float],
    offset: float,
    color: Any,
    style: str,
    name: str,
) -> None:
    """One line with its intervals, and the seeds behind it."""
    rows = cells[cells["number"] == measure].sort_values(key, key=lambda column: column.map(places))
    if rows.empty:
        return
    x = rows[key].map(places).to_numpy(float) + offset
    mean = rows["mean"].to_numpy(float)
    low, high = (rows[end].fillna(rows[most]) for end, most in (("low", "smallest"), ("high", "largest")))
    ends = np.abs(np.stack((low, high)).astype(float) - mean)
    look: dict[str, Any] = {"color": color, "linestyle": style, "linewidth": 1.4, "capsize": 2.5}
    axes.errorbar(x, mean, np.nan_to_num(ends), marker="" if style else ".", label=name or None, **look)
    if measure in jobs:
        seeds = jobs[jobs[measure].notna()]
        dots = seeds[key].map(places).to_numpy(float) + offset
        axes.plot(dots, seeds[measure].to_numpy(float), "o", color=color, markersize=3.2, alpha=0.45, linewidth=0)


def lower_is_better(number: str) -> bool:
    """Tell whether the smaller of two values of a number such as `student/falls_percent` is the better one."""
    name = number.rpartition("/")[2]
    return name in ("student", "baseline") or (name in MEASURES and MEASURES[name].better == "lower")


def heat_maps(keys: tuple[str, str], cells: pd.DataFrame, maps: Keys, title: str) -> Figure:
    """Means over seeds, and over what else varies, against two keys; empty where no job has the number."""
    figure = new_figure(11.0, 3.9)
    rows, columns = (ordered(cells[key]) for key in keys)
    for axes, measure in zip(figure.subplots(1, len(maps)), maps, strict=True):
        grid = np.full((len(rows), len(columns)), math.nan)
        found = cells[cells["number"] == measure].groupby([*keys], as_index=False)["mean"].mean()
        for row, column, mean in zip(found[keys[0]], found[keys[1]], found["mean"], strict=True):
            grid[rows.index(row), columns.index(column)] = mean
        axes.set_title(measure, fontsize=9, color=INK, loc="left")
        falling = lower_is_better(measure)  # bright is good
        image = axes.imshow(grid, aspect="auto", cmap="viridis_r" if falling else "viridis")
        for (row, column), mean in np.ndenumerate(grid):
            if math.isfinite(mean):
                middle = (np.nanmin(grid) + np.nanmax(grid)) / 2
                color = "white" if (mean < middle) != falling else "black"
                axes.text(column, row, significant(mean), ha="center", va="center", fontsize=8, color=color)
        axes.set_xticks(range(len(columns)), columns, fontsize=8)
        axes.set_yticks(range(len(rows)), rows, fontsize=8)
        axes.set_xlabel(keys[1], fontsize=9, color=INK)
        axes.set_ylabel(keys[0], fontsize=9, color=INK)
        if np.isfinite(grid).any():
            figure.colorbar(image, ax=axes)
    heading(figure, f"{title}: {note_of(cells)}")
    return figure


def note_of(cells: pd.DataFrame) -> str:
    """On how many seeds the points stand, and what must be said beside them."""
    fewest, most = int(cells["seeds"].min()), int(cells["seeds"].max())
    seeds = (
        "one seed, no interval" if most == 1 else f"mean of {fewest if fewest == most else f'{fewest} to {most}'} seeds"
    )
    bars = "smallest to largest" if most < FEWEST_SEEDS else "95% bootstrap interval"
    bars += " (fewer than five: smallest to largest)" if fewest < FEWEST_SEEDS <= most else ""
    seeds += "" if most == 1 else f", {bars}, a dot per seed"
    return seeds + ("; short budget" if cells["note"].str.contains("short budget").any() else "")


def heading(figure: Figure, text: str) -> None:
    """The title of a figure, at its left."""
    figure.suptitle(text, fontsize=11, x=0.01, ha="left", color=INK)
