"""How every figure looks: colours, axes, and saving as PNG and PDF. No pyplot; Matplotlib's own settings."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

TEACHER, STUDENT, BASELINE = "#009e73", "#0072b2", "#d55e00"  # Okabe and Ito 2008: told apart by colour-blind eyes
OTHERS = (
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#f0e442",
    "#000000",
    "#999999",
    "#7b5ea7",
)  # what stands in the student's place
COLORS = {"teacher": TEACHER, "student": STUDENT, "baseline": BASELINE}
WALKER_LABELS = {
    "teacher": "teacher (reduced-order model)",
    "student": "student",
    "baseline": "baseline (reward only)",
}
CHANNEL_LABELS = {
    "pelvis_y": "pelvis height",
    "left_foot_x": "left foot x",
    "left_foot_z": "left foot z",
    "right_foot_x": "right foot x",
    "right_foot_z": "right foot z",
}
INK, FAINT = "#303030", "#d9d9d9"
DPI = 160

matplotlib.rcdefaults()  # a matplotlibrc of the user's changes no figure, nor asks for a LaTeX that is not there


def new_figure(width: float, height: float) -> Figure:
    """A figure of `width` x `height` inches that lays itself out, drawn by Agg."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def dress(axes: Axes, *, title: str = "", xlabel: str = "", ylabel: str = "") -> None:
    """Common look of one plot: light grid, no box, units in the labels."""
    axes.set_title(title, fontsize=10, color=INK, loc="left")
    axes.set_xlabel(xlabel, fontsize=9, color=INK)
    axes.set_ylabel(ylabel, fontsize=9, color=INK)
    axes.tick_params(labelsize=8, colors=INK, length=3)
    axes.grid(True, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#909090")


def save(figure: Figure, directory: Path, name: str) -> list[Path]:
    """Write `name`.png and `name`.pdf; the PDF carries no date, so that the same data gives the same file."""
    paths = [directory / f"{name}.png", directory / f"{name}.pdf"]
    figure.savefig(paths[0], dpi=DPI)
    figure.savefig(paths[1], metadata={"CreationDate": None})
    return paths
