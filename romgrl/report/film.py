"""Films and filmstrips. Where no OpenGL can be had, poses are drawn as stick figures and films are left out."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from romgrl.gait.features import Floats
from romgrl.report.encoder import FilmError, Image, write_film
from romgrl.report.style import COLORS, INK, WALKER_LABELS, new_figure

__all__ = ["FilmError", "Image", "write_film"]


def stride_steps(states: Floats, stride_frequency: float, dt: float, poses: int) -> NDArray[np.int64]:
    """`poses` steps, evenly spaced over the last stride of a recorded episode; 0.7 s where there is no stride."""
    duration = 1.0 / stride_frequency if np.isfinite(stride_frequency) and stride_frequency > 0 else 0.7
    last = len(states) - 1
    return np.linspace(max(0, last - round(duration / dt)), last, poses).round().astype(np.int64)


def strip_of_pictures(rows: Mapping[str, Sequence[Image]], times: Mapping[str, Floats]) -> Figure:
    """Rendered poses, one row per walker; times (P,) s from the first pose."""
    figure, grid = _strip(rows, times)
    for (name, frames), axes in zip(rows.items(), grid, strict=True):
        for plot, frame in zip(axes, frames, strict=True):
            plot.imshow(frame)
            _frame(plot, COLORS[name])
    return figure


def strip_of_sticks(
    model: Any, rows: Mapping[str, Floats], times: Mapping[str, Floats], far: Collection[str]
) -> Figure:
    """Stick figures of states (P, nq or more) from the side, one row per walker; bodies of the `far` side are faint."""
    figure, grid = _strip(rows, times)
    for (name, states), axes in zip(rows.items(), grid, strict=True):
        for plot, state in zip(axes, states, strict=True):
            segments, faint = side_view(model, state, far)
            plot.add_collection(LineCollection(list(segments[faint]), colors=COLORS[name], linewidths=1.6, alpha=0.4))
            plot.add_collection(LineCollection(list(segments[~faint]), colors=COLORS[name], linewidths=2.2))
            plot.axhline(0.0, color=INK, linewidth=0.8)
            plot.set_xlim(-0.85, 0.85)
            plot.set_ylim(-0.05, 1.95)
            plot.set_aspect("equal")
            _frame(plot, COLORS[name])
    return figure


def side_view(model: Any, state: Floats, far: Collection[str]) -> tuple[Floats, NDArray[np.bool_]]:
    """Lines (S, 2, 2) m from each body to its parent, x relative to the root, and which bodies are of `far` (S,)."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = state[: model.nq]
    mujoco.mj_kinematics(model, data)
    root = int(model.body_rootid[model.jnt_bodyid[0]])  # the body that moves
    children = [body for body in range(root + 1, model.nbody) if model.body_rootid[body] == root]
    parents = [int(model.body_parentid[body]) for body in children]
    points = data.xpos[:, [0, 2]] - [data.xpos[root, 0], 0.0]
    faint = np.array([model.body(body).name in far for body in range(model.nbody)], bool)
    for body, parent in zip(children, parents, strict=True):
        faint[body] |= faint[parent]  # what hangs from a body is of its side
    return np.stack((points[parents], points[children]), axis=1), faint[children]


def _strip(rows: Mapping[str, Sequence[Any] | Floats], times: Mapping[str, Floats]) -> tuple[Figure, Any]:
    poses = max((len(row) for row in rows.values()), default=1)
    figure = new_figure(1.35 * poses, 2.15 * max(1, len(rows)) + 0.3)
    grid = figure.subplots(max(1, len(rows)), poses, squeeze=False)
    for name, axes in zip(rows, grid, strict=True):
        axes[0].set_ylabel(WALKER_LABELS[name], fontsize=9, color=COLORS[name])
        for plot, time in zip(axes, times[name], strict=True):
            plot.set_xlabel(f"{time:.2f} s", fontsize=8, color=INK)
    figure.suptitle("One stride of each walker", fontsize=12, x=0.01, ha="left", color=INK)
    return figure, grid


def _frame(plot: Any, color: str) -> None:
    plot.set_xticks([])
    plot.set_yticks([])
    for side in plot.spines.values():
        side.set_color(color)
        side.set_linewidth(0.8)
