"""The charts of the page: Plotly figures, each with what its cursor follows; text and grid get their colours there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from matplotlib.colors import to_rgb

from romgrl.gait.features import BODY_Y, CHANNELS, LEFT_X, RIGHT_X, Floats
from romgrl.report.page.scene import Track
from romgrl.report.page.strides import PHASES, StrideAverage, phases
from romgrl.report.style import CHANNEL_LABELS, COLORS

DASHES = {"teacher": "solid", "student": "solid", "baseline": "dash"}  # the second way to tell them apart
WIDTHS = {"teacher": 3.0, "student": 2.0, "baseline": 2.0}
ORDER = ("teacher", "baseline", "student")  # the student is drawn last, on top
LEGS = ("left", "right")
BAND = 0.18  # opacity


@dataclass(frozen=True)
class Chart:
    """One plot, `height` pixels high; None: as the page's style says.

    cursor: None, `time` (a line at the player's time), or what each dot follows: in the report, per walker, the point
    (x, y) of each step.
    """

    key: str
    title: str
    figure: Any
    cursor: str | dict[str, dict[str, Any]] | None = None
    height: int | None = None


def channels(tracks: Mapping[str, Track], dt: float) -> list[Chart]:
    """The five channels and the forward speed over the player's time."""
    found = []
    for index, channel in enumerate(CHANNELS):
        curves = {name: (_times(track, dt), track.features[:, index]) for name, track in tracks.items()}
        title = CHANNEL_LABELS[channel]
        found.append(Chart(f"channel-{channel}", title, curves_figure(curves, "time [s]", f"{title} [m]"), "time"))
    speeds = {name: (_times(track, dt), track.velocity) for name, track in tracks.items()}
    return [*found, Chart("channel-speed", "forward speed", curves_figure(speeds, "time [s]", "speed [m/s]"), "time")]


def footfall(tracks: Mapping[str, Track], dt: float) -> Chart:
    """When each foot of each walker is on the ground."""
    figure = empty_figure("time [s]", "")
    shown = [name for name in ORDER if name in tracks]
    rows = [f"{name} {side}" for name in shown for side in reversed(LEGS)]
    for name in shown:
        for foot, side in enumerate(LEGS):
            starts, lengths = contact_spans(tracks[name].contact[:, foot])
            figure.add_bar(
                base=dt * (starts + tracks[name].offset),
                x=dt * lengths,
                y=[f"{name} {side}"] * len(starts),
                orientation="h",
                marker={"color": COLORS[name], "line": {"width": 0}, "opacity": 1.0 if foot == 0 else 0.55},
                hovertemplate="%{base:.2f} s, %{x:.2f} s long<extra></extra>",
            )
    end = dt * max(track.end for track in tracks.values())
    figure.update_layout(bargap=0.25, barmode="overlay", margin={"l": 92})
    figure.update_xaxes(range=[0.0, end])
    figure.update_yaxes(categoryorder="array", categoryarray=rows)
    return Chart("footfall", "feet on the ground", figure, "time")


def contact_spans(contact: Any) -> tuple[Any, Any]:
    """First steps and lengths of the runs of True in (T,)."""
    edges = np.diff(np.concatenate(([False], contact, [False])).astype(int))
    starts = np.flatnonzero(edges == 1)
    return starts, np.flatnonzero(edges == -1) - starts


def portraits(tracks: Mapping[str, Track], dt: float) -> list[Chart]:
    """Phase portraits: a channel against its own rate of change."""
    found = []
    for channel in (BODY_Y, LEFT_X, RIGHT_X):
        title = CHANNEL_LABELS[CHANNELS[channel]]
        curves = {
            name: (track.features[:, channel], np.gradient(track.features[:, channel], dt))
            for name, track in tracks.items()
            if len(track.x) > 1
        }
        figure = curves_figure(curves, f"{title} [m]", "rate [m/s]", thin=True)
        found.append(Chart(f"portrait-{CHANNELS[channel]}", title, figure, _points(curves, tracks)))
    return found


def stride_averages(averages: Mapping[str, StrideAverage], tracks: Mapping[str, Track]) -> list[Chart]:
    """Mean of each channel over a stride, one standard deviation on both sides; the cursors are at each one's phase."""
    found = []
    for channel, key in enumerate(CHANNELS):
        figure = empty_figure("stride from left touchdown [%]", f"{CHANNEL_LABELS[key]} [m]")
        cursor = {}
        for name in (name for name in ORDER if name in averages):
            mean, deviation = averages[name].mean[:, channel], averages[name].deviation[:, channel]
            band(figure, 100.0 * PHASES, mean - deviation, mean + deviation, name)
            line(figure, 100.0 * PHASES, mean, name)
            at = phases(len(tracks[name].x), tracks[name].strides, tracks[name].offset)
            cursor[name] = _cursor(100.0 * at, np.interp(at, PHASES, mean), tracks[name].offset)
        found.append(Chart(f"stride-{key}", CHANNEL_LABELS[key], figure, cursor))
    return found


def error_chart(table: pd.DataFrame) -> Chart:
    """The error of every channel with its interval, and the teacher's own. table: mse.csv (aligned) and intervals."""
    figure = empty_figure("", "mean squared error [m²]")
    labels = [CHANNEL_LABELS.get(channel, channel).replace(" ", "<br>", 1) for channel in table.channel]
    for name in ("baseline", "student"):
        values = table[name].to_numpy(float)
        figure.add_scatter(
            x=labels,
            y=values,
            error_y={
                "array": table[f"{name}_high"].to_numpy(float) - values,
                "arrayminus": values - table[f"{name}_low"].to_numpy(float),
                "color": COLORS[name],
                "thickness": 2,
            },
            mode="markers",
            name=name,
            marker={"color": COLORS[name], "size": 10, "symbol": "diamond" if name == "baseline" else "circle"},
        )
    figure.add_scatter(
        x=labels,
        y=table["teacher_floor"].to_numpy(float),
        mode="markers",
        name="teacher's own floor",
        marker={"color": COLORS["teacher"], "size": 16, "symbol": "line-ew-open", "line": {"width": 3}},
    )
    figure.update_yaxes(type="log", exponentformat="power", title={"standoff": 12})
    figure.update_layout(showlegend=True, legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0})
    figure.update_layout(margin={"l": 70, "t": 34, "b": 48})
    return Chart("errors", "error against the teacher (log scale)", figure)


def curves_figure(curves: Mapping[str, tuple[Any, Any]], x: str, y: str, *, thin: bool = False) -> Any:
    """Curves (x, y) of walkers in their colours."""
    figure = empty_figure(x, y)
    for name in (name for name in ORDER if name in curves):
        line(figure, *curves[name], name, thin=thin)
    return figure


def empty_figure(x: str, y: str) -> Any:
    """A figure with its axes named; the page gives it colours and size."""
    figure = go.Figure(layout={"template": "none", "showlegend": False, "margin": {"l": 56, "r": 10, "t": 8, "b": 42}})
    figure.update_xaxes(title={"text": x, "standoff": 6}, zeroline=False)
    figure.update_yaxes(title={"text": y, "standoff": 4}, zeroline=False)
    return figure


def line(figure: Any, x: Any, y: Any, name: str, *, thin: bool = False, **style: Any) -> None:
    """One curve of a walker."""
    look = {"color": COLORS[name], "width": 1.2 if thin else WIDTHS[name], "dash": DASHES[name], **style}
    figure.add_scatter(x=_short(x), y=_short(y), mode="lines", name=name, line=look)


def band(figure: Any, x: Any, low: Any, high: Any, name: str) -> None:
    """A band of a walker between two curves, without hover."""
    red, green, blue = (round(255 * part) for part in to_rgb(COLORS[name]))
    figure.add_scatter(
        x=_short(np.concatenate((x, x[::-1]))),
        y=_short(np.concatenate((high, low[::-1]))),
        mode="lines",
        fill="toself",
        fillcolor=f"rgba({red},{green},{blue},{BAND})",
        line={"width": 0},
        hoverinfo="skip",
        name=f"{name} ± SD",
    )


def _times(track: Track, dt: float) -> Floats:
    return dt * np.arange(track.offset, track.end)


def _points(curves: Mapping[str, tuple[Any, Any]], tracks: Mapping[str, Track]) -> dict[str, dict[str, Any]]:
    return {name: _cursor(x, y, tracks[name].offset) for name, (x, y) in curves.items()}


def _cursor(x: Any, y: Any, offset: int) -> dict[str, Any]:
    """Where a walker's dot is, from step `offset` on; null where it is nowhere."""
    return {"offset": offset, "x": listed(x), "y": listed(y)}


def listed(values: Any) -> list[float | None]:
    """Numbers for JSON, to four decimals; null for what is not known."""
    return [round(float(value), 4) if np.isfinite(value) else None for value in values]


def _short(values: Any) -> Any:
    """Single precision, which Plotly packs into half the space."""
    return np.asarray(values, np.float32)
