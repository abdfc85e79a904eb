"""The gait numbers of each walker beside the band of human adults at the same speed."""

from __future__ import annotations

import math

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romgrl.gait import human_bands
from romgrl.gait.measures import MEASURES, PANELS
from romgrl.report.numbers import measured
from romgrl.report.style import COLORS, INK, dress, new_figure

HUMAN = "#dcdcdc"


def gait_bands(gaits: pd.DataFrame, speed: float) -> Figure:
    """One panel per measure: a dot per walker of gait.csv, over the human band (grey) at `speed` m/s."""
    bands = human_bands.bands(speed)
    columns = {str(name): gaits[name].astype(float) for name in gaits if name != "walker"}
    rows = [{name: float(column.iloc[place]) for name, column in columns.items()} for place in range(len(gaits))]
    numbers = [{**row, "stride_length_m": human_bands.stride_length(row)} for row in rows]
    walkers = [str(walker) for walker in gaits["walker"]]
    figure = new_figure(10.0, 3.2)
    for axes, measure in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        dress(axes, title=MEASURES[measure].title)
        axes.grid(False, axis="x")
        if measure in bands:
            band = bands[measure]
            axes.axhspan(band.low, band.high, color=HUMAN, zorder=0)
        _dots(axes, measure, {walker: row.get(measure, math.nan) for walker, row in zip(walkers, numbers, strict=True)})
    known = "grey: human adults" if bands else "no human data at this speed"
    figure.suptitle(f"Gait at {speed:g} m/s ({known})", fontsize=12, x=0.01, ha="left", color=INK)
    return figure


def human_table(speed: float) -> pd.DataFrame:
    """The human bands at a speed with their sources, for reading; no row where nothing is known."""
    bands = human_bands.bands(speed)
    rows = [
        (MEASURES[name].title, band.low, band.high, band.source) for name, band in bands.items() if name in MEASURES
    ]
    return pd.DataFrame(rows, columns=["measure", "low", "high", "source"])


def _dots(axes: Axes, measure: str, values: dict[str, float]) -> None:
    """A dot with its number for each walker; a walker without a number keeps its place."""
    for place, (walker, value) in enumerate(values.items()):
        axes.plot([place], [value], "o", color=COLORS[walker], markersize=8)
        text = measured(measure, value)
        axes.annotate(text, (place, value), (0, 8), textcoords="offset points", ha="center", fontsize=8)
    axes.set_xticks(range(len(values)), list(values))
    axes.set_xlim(-0.6, len(values) - 0.4)
    axes.margins(y=0.25)
    axes.set_ylim(bottom=0.0)
