"""Charts of the trainings: learning curves, and the health of the discriminator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from romgrl.report.page.charts import Chart, empty_figure, line
from romgrl.report.style import COLORS

GREY = "#808080"
HUMANOID = (
    ("speed", "forward speed", "m/s"),
    ("episode_seconds", "episode length", "s"),
    ("fall_share", "share of episodes that end in a fall", ""),
    ("trunk_lean_degrees", "trunk lean", "deg"),
    ("task_reward", "task reward per step", ""),
    ("imitation_reward", "imitation reward per step", ""),
)
MODEL = (("speed", "teacher: forward speed", "m/s"), ("left_right_correlation", "teacher: left-right correlation", ""))
LOGIT_STREAMS = (
    ("accuracy", "accuracy on each stream"),
    ("logit", "mean logit of each stream"),
)
LOSS_COLUMNS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("discriminator_fit_loss", {}),
    ("discriminator_held_out_loss", {"dash": "dot", "color": GREY}),
)


def learning_curves(curves: Mapping[str, pd.DataFrame], targets: Mapping[str, float]) -> list[Chart]:
    """Numbers over environment steps from curve.csv of teacher, student and baseline; targets: speed of each, m/s."""
    walkers = {name: curve for name, curve in curves.items() if name != "teacher"}
    teacher = {name: curve for name, curve in curves.items() if name == "teacher"}
    return _panels(HUMANOID, walkers, targets) + _panels(MODEL, teacher, targets)


def discriminator(curve: pd.DataFrame, spells: list[dict[str, Any]]) -> list[Chart]:
    """What the discriminator makes of both streams; grey where health.json has a spell of something wrong."""
    charts = []
    for key, title in LOGIT_STREAMS:
        figure = empty_figure("environment steps", "")
        columns = {name: f"discriminator_{key}_{name}" for name in ("teacher", "student")}
        for name, column in columns.items():
            if column in curve:
                line(figure, curve["step"], curve[column], name)
        charts.append(Chart(f"discriminator-{key}", title, figure))
    losses = empty_figure("environment steps", "")
    for column, look in LOSS_COLUMNS:
        if column in curve:
            line(losses, curve["step"], curve[column], "student", **look)
    gap = empty_figure("environment steps", "standard deviations")
    if "discriminator_feature_gap" in curve:
        line(gap, curve["step"], curve["discriminator_feature_gap"], "student")
    charts.append(Chart("discriminator-loss", "loss: windows it learns from (solid), held out (dotted)", losses))
    charts.append(Chart("discriminator-gap", "distance between the streams' features", gap))
    charts = [chart for chart in charts if chart.figure.data]
    for chart in charts:
        for spell in spells:
            chart.figure.add_vrect(spell["first_step"], spell["last_step"], fillcolor=GREY, opacity=0.25, line_width=0)
    return charts


def _panels(
    panels: tuple[tuple[str, str, str], ...], curves: Mapping[str, pd.DataFrame], targets: Mapping[str, float]
) -> list[Chart]:
    charts = []
    for column, title, unit in panels:
        figure = empty_figure("environment steps", unit)
        for name in _having(curves, column):
            line(figure, curves[name]["step"], curves[name][column], name)
            if column == "speed":
                figure.add_hline(targets[name], line={"color": COLORS[name], "width": 1, "dash": "dot"})
        if figure.data:
            charts.append(Chart(f"training-{'-'.join((*curves, column))}", title, figure))
    return charts


def _having(curves: Mapping[str, pd.DataFrame], column: str) -> list[str]:
    return [name for name in COLORS if name in curves and column in curves[name] and curves[name][column].notna().any()]
