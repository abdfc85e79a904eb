"""The atlas of a library: what its gaits measure over speed, beside what people do."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romgrl.report.library_cells import ASKED, MEASURED_CELLS, band_curve, cell_lines, goal_label, goals
from romgrl.report.style import BASELINE, FAINT, INK, OTHERS, STUDENT, TEACHER, dress, new_figure

STIFFNESS_COLORS = (STUDENT, TEACHER, BASELINE, *OTHERS[:3], OTHERS[-1])  # seen on white and on black
LINE_STYLES = ("-", "--", ":", "-.")  # of gaits
FULL_ROW = 4  # panels


def gait_atlas(table: pd.DataFrame) -> Figure:
    """A panel for each measure against the speed asked for, a line for each stiffness and gait; table: library.csv.

    Full points are cells whose reference is fit to be imitated; grey: the human bands.
    """
    shown = [name for name in MEASURED_CELLS if name in table]
    across = max(FULL_ROW, len(shown) // 2 + 1)  # one panel is left for the legend
    figure = new_figure(3.25 * across, 6.0)
    panels = list(figure.subplots(2, across).flat)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    lines = cell_lines(table)
    for axes, name in zip(panels, shown, strict=False):
        dress(axes, title=MEASURED_CELLS[name], xlabel=goal_label(table))
        draw_bands(axes, name, table)
        for line in lines:
            color, own = STIFFNESS_COLORS[line.color % len(STIFFNESS_COLORS)], line.rows
            style = LINE_STYLES[line.dash % len(LINE_STYLES)]
            axes.plot(goals(own), own[name], color=color, linestyle=style, linewidth=1.2, label=line.label)
            for fit, cells in own.groupby("fit"):
                face = color if fit else "white"
                axes.plot(goals(cells), cells[name], "o", ms=4, color=color, markerfacecolor=face)
        for asked in (table[ASKED[name]].sort_values(),) if name in ASKED else ():
            axes.plot(asked, asked, color=INK, linewidth=0.8, linestyle=":")
    handles, labels = panels[0].get_legend_handles_labels()
    panels[-1].legend(handles, labels, frameon=False, fontsize=8)
    fit = f"{int(table.fit.sum())} of {len(table)} cells are fit to be imitated (full points); grey: human bands"
    figure.suptitle(f"Gait atlas: {fit}", fontsize=12, x=0.01, ha="left", color=INK)
    return figure


def draw_bands(axes: Axes, measure: str, table: pd.DataFrame) -> None:
    """What people show of a measure, over the speeds of a table at which it is known."""
    places, low, high = band_curve(measure, table)
    axes.fill_between(places, low, high, color=FAINT, linewidth=0, zorder=0)
