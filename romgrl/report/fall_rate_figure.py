"""Fall rate under disturbances. Student blue, baseline orange, what stands in the student's place in other colours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import cycle

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from romgrl.report.style import COLORS, INK, OTHERS, WALKER_LABELS, dress, new_figure

TITLES = {
    "push_forward": ("push forward", "impulse per body mass [N s/kg]"),
    "push_backward": ("push backward", "impulse per body mass [N s/kg]"),
    "observation_noise": ("observation noise", "standard deviations of each entry"),
    "mass": ("body mass", "share of the trained mass"),
    "friction": ("ground friction", "share of the trained friction"),
}


def fall_rates(table: pd.DataFrame, speed: float, bands: str = "95% intervals") -> Figure:
    """Fall rate of each walker against the level of each disturbance, with a band from `low` to `high`.

    table: robustness.csv, or the same over seeds; bands: what they are.
    """
    figure = new_figure(10.0, 6.0)
    plots, colors = list(figure.subplots(2, 3, sharey=True).flat), _colors(table.walker.unique())
    for axes, (name, (title, label)) in zip(plots, TITLES.items(), strict=False):
        dress(axes, title=title, xlabel=label, ylabel="fall rate" if axes.get_subplotspec().is_first_col() else "")
        _curves(axes, table[table.perturbation == name], colors)
        axes.set_ylim(-0.03, 1.03)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    plots[-1].axis("off")
    plots[-1].legend(*plots[0].get_legend_handles_labels(), loc="center", frameon=False, fontsize=10)
    trials = f"{table.trials.iloc[0]} trials per point, bands: {bands}"
    figure.suptitle(f"Falls under disturbances at {speed:g} m/s ({trials})", fontsize=12, x=0.01, ha="left", color=INK)
    return figure


def _colors(walkers: Iterable[str]) -> dict[str, str]:
    return COLORS | dict(zip((name for name in walkers if name not in COLORS), cycle(OTHERS), strict=False))


def _curves(axes: Axes, rows: pd.DataFrame, colors: Mapping[str, str]) -> None:
    for walker in rows.walker.unique():
        own = rows[rows.walker == walker].sort_values("level")
        label, color = WALKER_LABELS.get(walker, walker), colors[walker]
        axes.fill_between(own.level, own.low, own.high, color=color, alpha=0.18, linewidth=0)
        axes.plot(own.level, own.fall_rate, color=color, linewidth=1.6, marker="o", ms=3, label=label)
