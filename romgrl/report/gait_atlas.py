"""The atlas of a library: what its gaits measure over speed, beside what people do."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romgrl.report.library_cells import (
    ASKED,
    MEASURED_CELLS,
    band_curve,
    cell_lines,
    drawn_cells,
    goal_label,
    goals,
)
from romgrl.report.style import BASELINE, FAINT, INK, OTHERS, STUDENT, TEACHER, dress, new_figure

CELL_COLORS = (STUDENT, TEACHER, BASELINE, *OTHERS[:3], OTHERS[-1])  # seen on white and on black
CELL_STYLES = ("-", "--", ":", "-.")
FULL_ROW = 4  # panels


def gait_atlas(table: pd.DataFrame) -> Figure:
    """A panel for each measure against the speed asked for, a line for each gait and stiffness; table: library.csv.

    Full points are cells whose reference is fit to be imitated; grey: the human bands.
    """
    shown = [name for name in MEASURED_CELLS if name in table]
    across = max(FULL_ROW, len(shown) // 2 + 1)  # one panel is left for the legend
    figure = new_figure(3.25 * across, 6.0)
    panels = list(figure.subplots(2, across).flat)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    lines = cell_lines(table)
    handles: dict[str, Any] = {}
    for axes, name in zip(panels, shown, strict=False):
        drawn = drawn_cells(table, name)
        dress(axes, title=MEASURED_CELLS[name], xlabel=goal_label(drawn))
        draw_bands(axes, name, drawn)
        for line in lines:
            color, own = CELL_COLORS[line.color % len(CELL_COLORS)], line.rows[line.rows.index.isin(drawn.index)]
            style = CELL_STYLES[line.dash % len(CELL_STYLES)]
            if own.empty:
                continue
            curve = axes.plot(goals(own), own[name], color=color, linestyle=style, linewidth=1.2)
            handles.setdefault(line.label, curve[0])
            for fit, cells in own.groupby("fit"):
                face = color if fit else "white"
                axes.plot(goals(cells), cells[name], "o", ms=4, color=color, markerfacecolor=face)
        for asked in (drawn[ASKED[name]].sort_values(),) if name in ASKED else ():
            axes.plot(asked, asked, color=INK, linewidth=0.8, linestyle=":")
    panels[-1].legend(handles.values(), handles, frameon=False, fontsize=8)
    fit = f"{int(table.fit.sum())} of {len(table)} cells are fit to be imitated (full points); grey: human bands"
    figure.suptitle(f"Gait atlas: {fit}", fontsize=12, x=0.01, ha="left", color=INK)
    return figure


def draw_bands(axes: Axes, measure: str, table: pd.DataFrame) -> None:
    """What people show of a measure, over the speeds of a table at which it is known."""
    places, low, high = band_curve(measure, table)
    axes.fill_between(places, low, high, color=FAINT, linewidth=0, zorder=0)
