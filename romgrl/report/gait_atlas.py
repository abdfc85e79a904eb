"""The atlas of a library: what its gaits measure over speed, beside what people do."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from romgrl.gait import human_bands
from romgrl.report.style import BASELINE, FAINT, INK, OTHERS, STUDENT, TEACHER, dress, new_figure

MEASURED_CELLS = {
    "steady_speed_m_per_s": "speed held [m/s]",
    "stride_frequency_hz": "stride frequency [Hz]",
    "duty_factor": "duty factor",
    "pelvis_excursion_m": "vertical excursion [m]",
    "peak_force_body_weights": "peak force [body weights]",
    "positive_work_j_per_kg_m": "positive work [J/kg/m]",
    "multiplier": "largest Floquet multiplier",
    "falls": "falls",
}
"""Columns of library.csv, and what stands over their panels."""
BAND_POINTS = 101


def gait_atlas(table: pd.DataFrame) -> Figure:
    """A panel for each measure against the speed asked for, a line for each stiffness; table: library.csv.

    Full points are cells whose reference is fit to be imitated; grey: the human bands.
    """
    figure = new_figure(13.0, 6.0)
    colors = dict(
        zip(sorted(table.stiffness_share.unique()), cycle((STUDENT, TEACHER, BASELINE, *OTHERS)), strict=False)
    )
    for axes, (name, label) in zip(figure.subplots(2, 4).flat, MEASURED_CELLS.items(), strict=True):
        dress(axes, title=label, xlabel="speed asked for [m/s]")
        draw_bands(axes, name, table.speed_m_per_s)
        for share, rows in table.groupby("stiffness_share") if name in table else ():
            own = rows.sort_values("speed_m_per_s")
            axes.plot(own.speed_m_per_s, own[name], color=colors[share], linewidth=1.2, label=f"stiffness x {share:g}")
            for fit, cells in own.groupby("fit"):
                face = colors[share] if fit else "white"
                axes.plot(cells.speed_m_per_s, cells[name], "o", ms=4, color=colors[share], markerfacecolor=face)
        if name == "steady_speed_m_per_s":
            axes.plot(table.speed_m_per_s, table.speed_m_per_s, color=INK, linewidth=0.8, linestyle=":")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.axes[-1].legend(handles, labels, frameon=False, fontsize=8)
    fit = f"{int(table.fit.sum())} of {len(table)} cells are fit to be imitated (full points); grey: human bands"
    figure.suptitle(f"Gait atlas: {fit}", fontsize=12, x=0.01, ha="left", color=INK)
    return figure


def draw_bands(axes: Axes, measure: str, speeds: pd.Series) -> None:
    """What people show of a measure, over the speeds of a table at which it is known."""
    places = np.linspace(speeds.min(), speeds.max(), BAND_POINTS)
    bands = [human_bands.bands(float(speed)).get(measure) for speed in places]
    low, high = (
        np.array([np.nan if band is None else getattr(band, end) for band in bands]) for end in ("low", "high")
    )
    axes.fill_between(places, low, high, color=FAINT, linewidth=0, zorder=0)
