"""The charts of a page of a student that follows commands: its grid over speed, heat maps, and its ramp over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from romgrl.gait.features import Floats
from romgrl.report.command_grid import (
    ERROR,
    GRID_MEASURES,
    HELD,
    SHOWN_NULLS,
    SPEED_LABEL,
    GridTables,
    grid_lines,
    measured_text,
    row_minima,
    rows_of,
)
from romgrl.report.page.charts import DASHES, WIDTHS, Chart, empty_figure, listed
from romgrl.report.page.library_charts import add_human_bands
from romgrl.report.page.training_charts import GREY
from romgrl.report.ramp_strides import GAIT_COLORS, RampStrides
from romgrl.report.style import COLORS

SYMBOLS = {"walk": "square", "run": "circle", "hop": "triangle-up", "skip": "diamond"}
NULL_DASHES = ("dash", "dot")
SHADES = "Cividis"
MARGIN, ROW, LEAST_HEIGHT = 110, 22, 260  # pixels of heat maps
RAMP_STEP = 3  # of the ramp's curves, steps


def grid_charts(tables: GridTables, numbers: Mapping[tuple[str, float], int]) -> list[Chart]:
    """A chart for each measure of the grid; numbers: of the cells that are played, by gait and speed."""
    found = []
    for name, label in GRID_MEASURES.items():
        if name not in tables.grid:
            continue
        figure = empty_figure(SPEED_LABEL, "")
        add_human_bands(figure, name, tables.grid)
        if name == HELD:
            ends = listed([tables.grid.speed_m_per_s.min(), tables.grid.speed_m_per_s.max()])
            figure.add_scatter(x=ends, y=ends, mode="lines", line={"color": GREY, "width": 1, "dash": "dot"})
            figure.update_traces(hoverinfo="skip")
        if name == ERROR:
            add_null_errors(figure, tables.grid)
            figure.update_yaxes(type="log", exponentformat="power")
        for line in grid_lines(tables.grid):
            add_walker(figure, line.walker, line.gait, line.rows, name, numbers)
        found.append(Chart(f"grid-{name}", label, figure, {"cell": {"y": ring(tables.student, name, numbers)}}))
    return found


def ring(student: pd.DataFrame, measure: str, numbers: Mapping[tuple[str, float], int]) -> list[float | None]:
    """Where the ring is on a chart when a cell plays; of errors, which stand on a logarithmic axis, the logarithm."""
    values = np.full(len(numbers), np.nan)
    for gait, speed, value in zip(student.gait, student.speed_m_per_s, student[measure], strict=True):
        if (gait, speed) in numbers:
            values[numbers[gait, speed]] = value
    if measure == ERROR:
        values = np.log10(np.where(values > 0, values, np.nan))
    return listed(values)


def add_walker(
    figure: Any, walker: str, gait: str, rows: pd.DataFrame, measure: str, numbers: Mapping[tuple[str, float], int]
) -> None:
    """A measure over the cells of one walker and gait: open where the reference was never taught."""
    symbol, label = SYMBOLS.get(gait, "circle"), escape(GRID_MEASURES[measure])
    texts = [
        f"<b>{walker}, {escape(gait)} {speed:g} m/s</b><br>{label}: {measured_text(measure, value)}"
        + ("" if taught else "<br>never taught")
        for speed, value, taught in zip(rows.speed_m_per_s, rows[measure].astype(float), rows.taught, strict=True)
    ]
    figure.add_scatter(
        x=listed(rows.speed_m_per_s),
        y=listed(rows[measure].astype(float)),
        mode="lines+markers",
        name=f"{walker}, {gait}",
        line={
            "color": COLORS[walker],
            "width": 0.7 * WIDTHS[walker],
            "dash": DASHES[walker],
        },
        marker={"size": 8, "symbol": [symbol if taught else f"{symbol}-open" for taught in rows.taught]},
        customdata=[numbers.get((gait, speed)) for speed in rows.speed_m_per_s],
        hovertext=texts,
        hoverinfo="text",
        hoverlabel={"align": "left"},
    )


def add_null_errors(figure: Any, grid: pd.DataFrame) -> None:
    """What walkers that learned nothing score at each cell; grey."""
    for dash, name in zip(NULL_DASHES, SHOWN_NULLS, strict=True):
        for gait, rows in rows_of(grid, name).groupby("gait"):
            figure.add_scatter(
                x=listed(rows.speed_m_per_s),
                y=listed(rows[ERROR]),
                mode="lines",
                name=f"{name}, {gait}",
                line={"color": GREY, "width": 1.2, "dash": dash},
                hovertemplate=f"{name}, {escape(str(gait))} %{{x}} m/s: %{{y:.3g}}<extra></extra>",
            )


def matrix_charts(tables: GridTables) -> list[Chart]:
    """Which gait is seen of those asked for, and how far the student is from the reference of each command."""
    gaits = heat_map(
        tables.confusion,
        tables.seen_percent,
        "gait seen",
        "%{y} asked, %{x} seen: %{z:.0f} %<extra></extra>",
        most=100.0,
    )
    gaits.update_traces(texttemplate="%{z:.0f}")
    asked = "%{y} asked, reference of %{x}: %{z:.3f}<extra></extra>"
    distances = heat_map(tables.mmd, tables.distances, "reference of", asked, most=None)
    least = row_minima(tables.mmd)
    known = np.isfinite(least)
    names = [str(name) for name in tables.mmd.columns]
    if not known.any():
        note = {"text": "too few episodes without a fall", "font": {"color": GREY}, "showarrow": False}
        distances.add_annotation(x=0.5, y=0.5, xref="paper", yref="paper", **note)
    distances.add_scatter(
        x=[names[int(column)] for column in least[known]],
        y=[str(name) for name in tables.mmd.index[known]],
        mode="markers",
        marker={"color": "#ffffff", "size": 8, "line": {"color": "#000000", "width": 1.5}},
        hoverinfo="skip",
    )
    return [
        Chart("confusion", "gait asked for and gait seen [% of episodes]", gaits, height=map_height(tables.confusion)),
        Chart(
            "mmd", "distance (MMD²) from each reference; dots: the nearest", distances, height=map_height(tables.mmd)
        ),
    ]


def heat_map(table: pd.DataFrame, values: Floats, x: str, hover: str, *, most: float | None) -> Any:
    """A heat map of values (R, C) with the names of a table, its first row on top."""
    figure = empty_figure(x, "asked for")
    figure.add_heatmap(
        x=[str(name) for name in table.columns],
        y=[str(name) for name in table.index],
        z=[listed(row) for row in values],
        colorscale=SHADES,
        zmin=0.0,
        zmax=most,
        showscale=False,
        hovertemplate=hover,
    )
    figure.update_xaxes(type="category", showgrid=False, tickangle=-60 if len(table.columns) > 8 else 0)
    figure.update_yaxes(type="category", showgrid=False, autorange="reversed")
    figure.update_layout(margin={"l": 84, "b": 92 if len(table.columns) > 8 else 48})
    return figure


def map_height(table: pd.DataFrame) -> int:
    """Pixels."""
    return max(LEAST_HEIGHT, MARGIN + ROW * len(table))


def ramp_charts(strides: RampStrides) -> list[Chart]:
    """Speed, cadence and duty factor of the ramp over time; coloured below: the gait of each stride."""
    shown = slice(None, None, RAMP_STEP)
    speed = empty_figure("time [s]", "speed [m/s]")
    time = listed(strides.time[shown])
    asked = {"color": GREY, "width": 2, "dash": "dash"}
    speed.add_scatter(x=time, y=listed(strides.asked[shown]), mode="lines", name="asked", line=asked)
    held = {"color": COLORS["student"], "width": 2}
    speed.add_scatter(x=time, y=listed(strides.held[shown]), mode="lines", name="held", line=held)
    middles = listed([0.5 * (start + stop) for start, stop in pairwise(strides.starts)])
    cadence, duty = empty_figure("time [s]", "strides/s"), empty_figure("time [s]", "duty factor")
    for figure, values in ((cadence, strides.cadence), (duty, strides.duty)):
        figure.add_scatter(
            x=middles,
            y=listed(values),
            mode="lines+markers",
            name="stride",
            line={"color": GREY, "width": 0.8},
            marker={"size": 6, "color": [GAIT_COLORS.get(gait, GREY) for gait in strides.gaits]},
            hovertext=strides.gaits,
            hoverinfo="text+x+y",
        )
    figures = {"speed": speed, "cadence": cadence, "duty": duty}
    for figure in figures.values():
        figure.update_xaxes(range=[0.0, float(strides.time[-1])])
        if strides.fell:
            fallen = {"fillcolor": GREY, "opacity": 0.2, "line_width": 0, "annotation_text": "fallen"}
            figure.add_vrect(float(strides.time[strides.upright]), float(strides.time[-1]), **fallen)
    titles = ("speed asked (dashed) and held", "cadence of each stride", "duty factor of each stride")
    return [
        Chart(f"ramp-{key}", title, figure, "time")
        for (key, figure), title in zip(figures.items(), titles, strict=True)
    ]


def gaits_seen(strides: RampStrides) -> Sequence[tuple[str, str]]:
    """The gaits of the ramp with their colours."""
    return [(name, GAIT_COLORS.get(name, GREY)) for name in dict.fromkeys(strides.gaits)]
