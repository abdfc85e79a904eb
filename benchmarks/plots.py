"""Plots of how costs grow, from the series in results.json."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes

from benchmarks.results import DOCUMENT, Row
from romgrl.report import style

IMAGES = DOCUMENT.parent / "images"
COLORS = (style.TEACHER, style.STUDENT, style.BASELINE)


def draw(rows: Sequence[Row], directory: Path = IMAGES) -> list[Path]:
    """Write a PNG for every pair of series that was measured."""
    series = {row["name"]: row["settings"]["series"] for row in rows if "series" in row.get("settings", {})}
    panels = {
        "scaling_environments": [("scaling_rom", environments), ("scaling_humanoids", environments)],
        "scaling_training": [("scaling_updates", updates), ("scaling_threads", threads)],
    }
    written = []
    for name, pair in panels.items():
        if not all(row in series for row, _ in pair):
            continue
        figure = style.new_figure(8.0, 3.2)
        for axes, (row, panel) in zip(figure.subplots(1, 2), pair, strict=True):
            panel(axes, row, series[row])
        path = directory / f"{name}.png"
        figure.savefig(path, dpi=style.DPI)
        written.append(path)
    return written


def environments(axes: Axes, row: str, points: list[dict[str, float]]) -> None:
    """Steps per second against number of worlds or humanoids."""
    thing, color = ("worlds", style.TEACHER) if row == "scaling_rom" else ("humanoids", style.STUDENT)
    axes.semilogx([p["x"] for p in points], [p["y"] for p in points], "o-", color=color)
    axes.set_ylim(bottom=0)
    style.dress(axes, title=f"{thing} stepped together", xlabel=f"number of {thing}", ylabel="control steps/s")


def updates(axes: Axes, row: str, points: list[dict[str, float]]) -> None:
    """Updates per second against batch size, a line for each width."""
    for color, width in zip(COLORS, sorted({p["width"] for p in points}), strict=False):
        line = [p for p in points if p["width"] == width]
        axes.loglog([p["x"] for p in line], [p["y"] for p in line], "o-", color=color, label=f"2 x {width:.0f}")
    axes.legend(fontsize=8, frameon=False)
    style.dress(axes, title="SAC updates", xlabel="batch size", ylabel="updates/s")


def threads(axes: Axes, row: str, points: list[dict[str, float]]) -> None:
    """Stage time against threads."""
    for stage, color in (("teacher", style.TEACHER), ("student", style.STUDENT)):
        axes.plot([p["x"] for p in points], [p[stage] for p in points], "o-", color=color, label=stage)
    axes.set_ylim(bottom=0)
    axes.set_xticks([p["x"] for p in points])
    axes.legend(fontsize=8, frameon=False)
    style.dress(axes, title="Short stages", xlabel="threads", ylabel="time (s)")
