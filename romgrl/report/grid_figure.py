"""The grid of a student that follows commands as figures: its measures over speed, and what it is taken for."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from romgrl.report.command_grid import (
    ERROR,
    GRID_MEASURES,
    HELD,
    SHOWN_NULLS,
    SPEED_LABEL,
    GridTables,
    grid_lines,
    row_minima,
    rows_of,
)
from romgrl.report.gait_atlas import draw_bands
from romgrl.report.grid_tables import WALKER_ORDER
from romgrl.report.style import COLORS, INK, WALKER_LABELS, dress, new_figure

MARKERS = {"walk": "s", "run": "o", "hop": "^", "skip": "D"}
NULL_STYLES = ("--", ":")
GREY = "#808080"
ACROSS = 4  # panels in a row
SHADES = "cividis"


def grid_figure(tables: GridTables) -> Figure:
    """A panel for each measure over the speed asked for; open: speeds whose reference was never taught."""
    shown = [name for name in GRID_MEASURES if name in tables.grid]
    figure = new_figure(3.4 * ACROSS, 3.0 * -(-len(shown) // ACROSS) + 0.5)
    panels = list(figure.subplots(-(-len(shown) // ACROSS), ACROSS, squeeze=False).flat)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    for axes, name in zip(panels, shown, strict=False):
        dress(axes, title=GRID_MEASURES[name], xlabel=SPEED_LABEL)
        draw_bands(axes, name, tables.grid)
        draw_walkers(axes, tables.grid, name)
        if name == ERROR:
            draw_null_errors(axes, tables.grid)
        if name == HELD:
            ends = [tables.grid.speed_m_per_s.min(), tables.grid.speed_m_per_s.max()]
            axes.plot(ends, ends, color=INK, linewidth=0.8, linestyle=":")
    legend(figure, tables.grid)
    figure.suptitle(
        "One student over the speeds of its library (grey areas: human adults)", x=0.01, ha="left", color=INK
    )
    return figure


def draw_walkers(axes: Axes, grid: pd.DataFrame, measure: str) -> None:
    """A line for each walker and gait."""
    for line in grid_lines(grid):
        color, rows, marker = COLORS[line.walker], line.rows, MARKERS.get(line.gait, "o")
        axes.plot(rows.speed_m_per_s, rows[measure], color=color, linewidth=1.2)
        for taught, cells in rows.groupby("taught"):
            face = color if taught else "white"
            axes.plot(cells.speed_m_per_s, cells[measure], marker, ms=4, color=color, markerfacecolor=face)


def draw_null_errors(axes: Axes, grid: pd.DataFrame) -> None:
    """What walkers that learned nothing score."""
    for style, name in zip(NULL_STYLES, SHOWN_NULLS, strict=True):
        for place, (_, rows) in enumerate(rows_of(grid, name).groupby("gait")):
            label = name if not place else None
            axes.plot(rows.speed_m_per_s, rows[ERROR], color=GREY, linewidth=1.0, linestyle=style, label=label)
    axes.set_yscale("log")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=6, frameon=False)


def legend(figure: Figure, grid: pd.DataFrame) -> None:
    """Walkers by colour, gaits by marker."""
    walkers = [name for name in WALKER_ORDER if name in set(grid.walker)]
    gaits = sorted(set(grid.gait))
    handles = [Line2D([], [], color=COLORS[name], linewidth=2.0) for name in walkers]
    handles += [Line2D([], [], color=INK, marker=MARKERS.get(gait, "o"), linestyle="") for gait in gaits]
    names = [*(WALKER_LABELS[name] for name in walkers), *gaits]
    if not grid.taught.all():
        handles.append(Line2D([], [], color=INK, marker="o", linestyle="", markerfacecolor="white"))
        names.append("never taught")
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False, fontsize=9)


def matrices_figure(tables: GridTables) -> Figure:
    """Which gait is seen of those asked for, and how far the student is from each reference."""
    side = max(3.6, 0.24 * len(tables.mmd) + 1.6)
    figure = new_figure(3.8 + side, side)
    left, right = figure.subplots(1, 2, width_ratios=(3.4, side))
    shares = tables.seen_percent
    draw_matrix(left, tables.confusion, shares, "gait seen [% of episodes]", most=100.0)
    for (row, column), share in np.ndenumerate(shares):
        left.text(
            column, row, f"{share:.0f}", ha="center", va="center", color="white" if share < 60 else "black", fontsize=8
        )
    draw_matrix(right, tables.mmd, tables.distances, "distance from each reference (MMD²)", most=None)
    least = row_minima(tables.mmd)
    right.plot(least, np.arange(len(least)), "o", ms=4, color="white", markeredgecolor="black")
    right.tick_params(axis="x", labelrotation=90)
    left.set_ylabel("asked for", fontsize=9)
    right.set_ylabel("asked for", fontsize=9)
    figure.suptitle("What the student is taken for (dots: the nearest reference)", x=0.01, ha="left", color=INK)
    return figure


def draw_matrix(axes: Axes, table: pd.DataFrame, values: np.ndarray, title: str, *, most: float | None) -> None:
    """A heat map of values (R, C) with the names of the table."""
    dress(axes, title=title)
    axes.grid(False)
    axes.imshow(values, cmap=SHADES, vmin=0.0, vmax=most, aspect="auto")
    axes.set_xticks(range(len(table.columns)), [str(name) for name in table.columns])
    axes.set_yticks(range(len(table.index)), [str(name) for name in table.index])
