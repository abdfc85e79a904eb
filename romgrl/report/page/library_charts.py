"""The charts of a library's page: each measure against the speed asked for, and when the feet are on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from textwrap import wrap
from typing import Any

import numpy as np
import pandas as pd

from romgrl.report.gait_atlas import CELL_COLORS
from romgrl.report.library_cells import ASKED, MEASURED_CELLS, CellLine, band_curve, goal_label, goal_text, goals
from romgrl.report.numbers import significant
from romgrl.report.page.charts import LEGS, Chart, contact_spans, empty_figure, listed
from romgrl.report.page.stretches import Stretch
from romgrl.report.page.training_charts import GREY

CELL_DASHES = ("solid", "dash", "dot", "dashdot")
BAND_FILL = "rgba(128,128,128,0.28)"
HOVER_WIDTH = 48  # letters
ROW_HEIGHT, AXIS_HEIGHT, LEAST_HEIGHT = 30, 60, 160  # pixels
FOOT_PLACES = (0.19, -0.19)  # of left and right in a row, in rows
FOOT_WIDTH = 0.34


def line_color(line: CellLine) -> str:
    """The color of a line, the same in every chart."""
    return CELL_COLORS[line.color % len(CELL_COLORS)]


def atlas_charts(table: pd.DataFrame, lines: Sequence[CellLine], said: Sequence[str]) -> list[Chart]:
    """A chart for each measure of library.csv that is there; said: of each cell. The dot is at the cell that plays."""
    found = []
    for name, label in MEASURED_CELLS.items():
        if name not in table:
            continue
        figure = empty_figure(goal_label(table), "")
        add_human_bands(figure, name, table)
        if name in ASKED:
            ends = listed([table[ASKED[name]].min(), table[ASKED[name]].max()])
            figure.add_scatter(x=ends, y=ends, mode="lines", line={"color": GREY, "width": 1, "dash": "dot"})
            figure.update_traces(hoverinfo="skip")
        for line in lines:
            add_cells(figure, line, name, said)
        found.append(Chart(f"atlas-{name}", label, figure, {"cell": {"y": listed(table[name])}}))
    return found


def add_human_bands(figure: Any, measure: str, table: pd.DataFrame) -> None:
    """What people show of a measure: an area for walking, one for running."""
    places, low, high = band_curve(measure, table)
    for start, length in zip(*contact_spans(np.isfinite(low)), strict=True):
        part = slice(start, start + length)
        figure.add_scatter(
            x=listed([*places[part], *places[part][::-1]]),
            y=listed([*high[part], *low[part][::-1]]),
            mode="lines",
            fill="toself",
            fillcolor=BAND_FILL,
            line={"width": 0},
            hoverinfo="skip",
            name="human band",
        )


def add_cells(figure: Any, line: CellLine, measure: str, said: Sequence[str]) -> None:
    """A measure over the cells of one line: filled where they are fit, open where they are refused."""
    color, cells = line_color(line), line.rows.index.tolist()
    values, label = line.rows[measure], escape(MEASURED_CELLS[measure])
    texts = [
        f"<b>{goal_text(speed, apex)}, {escape(line.label)}</b><br>{label}: {significant(value)}<br>"
        + ("fit: " if fit else "")
        + "<br>".join(wrap(escape(said[cell]), HOVER_WIDTH))
        for cell, speed, apex, value, fit in zip(
            cells, line.rows.speed_m_per_s, line.rows.apex_m, values, line.rows.fit, strict=True
        )
    ]
    figure.add_scatter(
        x=listed(goals(line.rows)),
        y=listed(values),
        mode="lines+markers",
        name=line.label,
        line={"color": color, "width": 1.6, "dash": CELL_DASHES[line.dash % len(CELL_DASHES)]},
        marker={"size": 8, "symbol": ["circle" if fit else "circle-open" for fit in line.rows.fit]},
        customdata=cells,
        hovertext=texts,
        hoverinfo="text",
        hoverlabel={"align": "left"},
    )


def footfall_charts(lines: Sequence[CellLine], stretches: Sequence[Stretch | None], dt: float) -> list[Chart]:
    """For each line when each foot is on the ground, a row for each speed; in s, so that it shows the cadence."""
    end = dt * max((len(stretch.x) - 1 for stretch in stretches if stretch is not None), default=1)
    return [footfall_chart(number, line, stretches, dt, end) for number, line in enumerate(lines)]


def footfall_chart(number: int, line: CellLine, stretches: Sequence[Stretch | None], dt: float, end: float) -> Chart:
    """The rows of one line up to `end` s; the dot is at the moment that plays."""
    figure = empty_figure("time from a touchdown of the left foot [s]", goal_label(line.rows))
    cells = line.rows.index.tolist()
    for row, cell in enumerate(cells):
        stretch = stretches[cell]
        if stretch is None:
            note = {"text": "no steady stretch", "font": {"color": GREY}, "showarrow": False, "xanchor": "left"}
            figure.add_annotation(x=0.0, y=row, **note)
            continue
        color = line_color(line) if line.rows.fit[cell] else GREY
        for foot, side in enumerate(LEGS):
            starts, lengths = contact_spans(stretch.contact[:-1, foot])
            figure.add_bar(
                base=listed(dt * starts),
                x=listed(dt * lengths),
                y=[row + FOOT_PLACES[foot]] * len(starts),
                width=FOOT_WIDTH,
                orientation="h",
                marker={"color": color, "line": {"width": 0}, "opacity": 0.5 if foot else 1.0},
                customdata=[cell] * len(starts),
                hovertemplate=f"{side}, %{{base:.2f}} s, %{{x:.2f}} s long<extra></extra>",
            )
        figure.add_scatter(
            x=listed(dt * np.array(stretch.strides)),
            y=[row] * len(stretch.strides),
            mode="markers",
            marker={"symbol": "line-ns", "size": 22, "line": {"color": GREY, "width": 1}},
            hoverinfo="skip",
        )
    figure.update_layout(barmode="overlay")
    figure.update_xaxes(range=[0.0, round(1.02 * end, 4)])
    speeds = [f"{goal:g}" for goal in goals(line.rows)]
    figure.update_yaxes(range=[-0.6, len(cells) - 0.4], tickvals=list(range(len(cells))), ticktext=speeds)
    rows = {"moment": {"rows": {str(cell): row for row, cell in enumerate(cells)}}}
    height = max(AXIS_HEIGHT + ROW_HEIGHT * len(cells), LEAST_HEIGHT)
    return Chart(f"footfall-{number}", line.label, figure, rows, height)
