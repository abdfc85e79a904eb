"""The paper's three figures (section 4.2) and the learning curves. Teacher green, student blue, baseline orange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romgrl.gait.features import BODY_Y, CHANNELS, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Floats
from romgrl.report.style import (
    BASELINE,
    CHANNEL_LABELS,
    COLORS,
    INK,
    STUDENT,
    TEACHER,
    WALKER_LABELS,
    dress,
    new_figure,
)

FOOT_CHANNELS = ((LEFT_X, LEFT_Z, "-"), (RIGHT_X, RIGHT_Z, (0, (1.2, 1.2))))
PATH_TIME = 1.6  # s of the paths over ground: two or three strides of a run
EMPHASIS: dict[str, dict[str, Any]] = {
    "teacher": {"linewidth": 2.2, "alpha": 0.9},
    "student": {"linewidth": 1.5},
    "baseline": {"linewidth": 1.5},
}


@dataclass(frozen=True)
class Pair:
    """One walker's scored window (W, 5) m of a typical episode, the teacher's window (W, 5) that it is laid over, and
    their forward velocities (W,) m/s."""

    window: Floats
    teacher: Floats
    velocity: Floats
    teacher_velocity: Floats


def paths(pairs: Mapping[str, Pair], dt: float, speed: float) -> Figure:
    """Pelvis and foot paths in the sagittal plane: above over ground, below relative to the body.

    pairs: `student` and `baseline`, or those of them that can be drawn.
    """
    figure = new_figure(11.0, 6.6)
    grid = figure.add_gridspec(2, 6, height_ratios=(1.0, 1.15))
    for place, name in enumerate(("student", "baseline")):
        axes = figure.add_subplot(grid[0, 3 * place : 3 * place + 3])
        dress(axes, title=f"{WALKER_LABELS[name]} over the teacher", xlabel="distance [m]", ylabel="height [m]")
        if name in pairs:
            pair = pairs[name]
            _over_ground(axes, pair.teacher, pair.teacher_velocity, dt, "teacher")
            _over_ground(axes, pair.window, pair.velocity, dt, name)
        else:
            _absent(axes)
        axes.set_ylim(bottom=0.0)
    walkers = _walkers(pairs)
    steps, loops = round(PATH_TIME / dt), None
    for place, (x, z, _) in enumerate(FOOT_CHANNELS):
        loops = figure.add_subplot(grid[1, 2 * place : 2 * place + 2], sharex=loops, sharey=loops)
        side = ("left", "right")[place]
        dress(loops, title=f"{side} foot about the pelvis", xlabel="forward of the pelvis [m]", ylabel="height [m]")
        for name, window in walkers.items():
            shown = window[:steps]
            loops.plot(shown[:, x], shown[:, BODY_Y] + shown[:, z], color=COLORS[name], **EMPHASIS[name])
    axes = figure.add_subplot(grid[1, 4:])
    dress(axes, title="pelvis", xlabel="time [s]", ylabel="height [m]")
    for name, window in walkers.items():
        axes.plot(dt * np.arange(len(window[:steps])), window[:steps, BODY_Y], color=COLORS[name], **EMPHASIS[name])
    _legend(figure, walkers, f"Pelvis and foot paths at {speed:g} m/s (left foot solid, right foot dotted)")
    return figure


def time_series(pair: Pair | None, dt: float, speed: float) -> Figure:
    """Pelvis height and both feet's x over the scored window: teacher solid, student dashed, one common time shift."""
    figure = new_figure(8.0, 6.2)
    axes = figure.subplots(3, 1, sharex=True)
    figure.suptitle(f"Teacher and student at {speed:g} m/s", fontsize=12, x=0.01, ha="left", color=INK)
    if pair is None:
        for plot in axes:
            dress(plot)
            _absent(plot)
        return figure
    steps = np.arange(len(pair.window))
    for plot, channel in zip(axes, (BODY_Y, LEFT_X, RIGHT_X), strict=True):
        label = CHANNEL_LABELS[CHANNELS[channel]]
        error = float(((pair.window[:, channel] - pair.teacher[:, channel]) ** 2).mean())
        dress(plot, ylabel=f"{label} [m]")
        plot.plot(steps, pair.teacher[:, channel], color=TEACHER, linewidth=2.0)
        plot.plot(steps, pair.window[:, channel], color=STUDENT, linewidth=1.6, linestyle="--")
        plot.set_title(f"mean squared error {error:.5f} m²", loc="right", fontsize=8, color=INK)
    axes[-1].set_xlabel(f"time step of {1000 * dt:.1f} ms", fontsize=9, color=INK)
    axes[-1].set_xlim(0, len(steps) - 1)
    figure.legend(
        axes[0].lines,
        [WALKER_LABELS["teacher"], WALKER_LABELS["student"]],
        loc="outside upper right",
        ncols=2,
        frameon=False,
    )
    return figure


def error_bars(table: pd.DataFrame, speed: float, alignment: str = "aligned") -> Figure:
    """MSE of baseline and student per channel, with the reduction above each pair and the teacher's own floor.

    table: mse.csv. Heights and fore-aft positions have their own linear scales: the latter are some ten times larger.
    """
    rows = table[table.alignment == alignment].set_index("channel")
    groups = (("pelvis_y", "left_foot_z", "right_foot_z"), ("left_foot_x", "right_foot_x"))
    figure = new_figure(9.0, 4.2)
    plots = figure.subplots(1, 2, width_ratios=(3, 2))
    for axes, channels, title in zip(plots, groups, ("heights", "fore-aft positions"), strict=True):
        dress(axes, title=title, ylabel="mean squared error [m²]")
        axes.grid(False, axis="x")
        _bars(axes, rows.loc[list(channels)])
    average = float(rows.reduction_percent["average"])
    summary = f"mean reduction {average:.1f} %" if np.isfinite(average) else str(rows.note["average"])
    figure.suptitle(f"Error against the teacher at {speed:g} m/s: {summary}", fontsize=12, x=0.01, ha="left", color=INK)
    handles, labels = plots[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def learning_curves(curves: Mapping[str, pd.DataFrame], targets: Mapping[str, float]) -> Figure:
    """Numbers over environment steps from curve.csv of teacher, student and baseline; targets: speed of each, m/s."""
    panels = (
        ("speed", "forward speed [m/s]"),
        ("episode_seconds", "episode length [s]"),
        ("trunk_lean_degrees", "trunk lean [deg]"),
        ("imitation_reward", "imitation reward per step"),
    )
    figure = new_figure(10.0, 6.0)
    for axes, (column, label) in zip(figure.subplots(2, 2).flat, panels, strict=True):
        dress(axes, xlabel="environment steps", ylabel=label)
        axes.ticklabel_format(axis="x", style="sci", scilimits=(0, 5))
        for name, curve in curves.items():
            if column in curve and curve[column].notna().any():
                marker = "o" if len(curve) == 1 else None
                axes.plot(curve["step"], curve[column], color=COLORS[name], linewidth=1.4, marker=marker)
        if column == "speed":
            for name in curves:
                axes.axhline(targets[name], color=COLORS[name], linewidth=0.8, linestyle=":")
        if not axes.lines:
            _absent(axes, "not recorded")
    _legend(figure, curves, "Learning curves (dotted: target speed)")
    return figure


def _over_ground(axes: Axes, window: Floats, velocity: Floats, dt: float, name: str) -> None:
    steps = min(len(window), round(PATH_TIME / dt))
    window = window[:steps]
    travelled = np.concatenate(([0.0], np.cumsum(velocity[: steps - 1]) * dt))
    axes.plot(travelled, window[:, BODY_Y], color=COLORS[name], **EMPHASIS[name])
    for x, z, line in FOOT_CHANNELS:
        style = {**EMPHASIS[name], "linestyle": line}
        axes.plot(travelled + window[:, x], window[:, BODY_Y] + window[:, z], color=COLORS[name], **style)


def _bars(axes: Axes, rows: pd.DataFrame) -> None:
    places = np.arange(len(rows))
    highest = np.nanmax([*rows.baseline, *rows.student, *rows.teacher_floor, 0.0]) or 1.0
    for offset, name, color in ((-0.2, "baseline", BASELINE), (0.2, "student", STUDENT)):
        values = rows[name].to_numpy(float)
        axes.bar(places + offset, np.nan_to_num(values), 0.38, color=color, label=WALKER_LABELS[name])
        for place, value in zip(places, values, strict=True):
            text, y = (f"{value:.4f}", value) if np.isfinite(value) else ("not\ncomparable", 0.0)
            axes.text(place + offset, y + 0.01 * highest, text, ha="center", va="bottom", fontsize=7, color=INK)
    axes.hlines(
        rows.teacher_floor, places - 0.42, places + 0.42, color=TEACHER, linewidth=1.8, label="teacher's own floor"
    )
    for center, (_, row) in zip(places.tolist(), rows.iterrows(), strict=True):
        if np.isfinite(row.reduction_percent):
            top = max(row.baseline, row.student) + 0.09 * highest
            change = f"{-row.reduction_percent:+.0f} %"
            axes.text(center, top, change, ha="center", fontsize=10, fontweight="bold", color=INK)
    axes.set_xticks(places, [CHANNEL_LABELS[channel] for channel in rows.index])
    axes.set_ylim(0.0, 1.22 * highest)


def _walkers(pairs: Mapping[str, Pair]) -> dict[str, Floats]:
    """The teacher under whichever walker is there, then the walkers; the student is drawn last, on top."""
    walkers = {"teacher": next(iter(pairs.values())).teacher} if pairs else {}
    return walkers | {name: pairs[name].window for name in ("baseline", "student") if name in pairs}


def _legend(figure: Figure, names: Mapping[str, object], title: str) -> None:
    from matplotlib.lines import Line2D

    shown = [name for name in COLORS if name in names]
    handles = [Line2D([], [], color=COLORS[name], linewidth=2.2) for name in shown]
    figure.suptitle(title, fontsize=12, x=0.01, ha="left", color=INK)
    figure.legend(
        handles, [WALKER_LABELS[n] for n in shown], loc="outside lower center", ncols=3, frameon=False, fontsize=9
    )


def _absent(axes: Axes, text: str = "not comparable: too few upright episodes") -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", fontsize=9, color="#808080")
