"""The ramp of a student that follows commands as a film and as a poster: the body above, what it does below."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from romgrl.gait.features import Floats
from romgrl.report.ramp_strides import GAIT_COLORS, RampStrides
from romgrl.report.style import FAINT, INK, STUDENT, dress, new_figure

RAMP_FILM = "ramp.mp4"
WIDTH, BODY_HEIGHT, STRIPS_HEIGHT = 960, 432, 324  # pixels
DOTS = 100  # per inch of the strips
TEXT = 20  # pixels
POSTER_POSES = 10
POSE_SHARE = 0.62
ASKED: dict[str, Any] = {"color": "#404040", "linewidth": 1.2, "linestyle": (0, (4, 2))}
Picture = NDArray[np.uint8]
BodyStates = NDArray[np.float64]
BodySegments = Callable[[BodyStates], tuple[Floats, NDArray[np.bool_]]]


def ramp_frames(frame: Callable[[BodyStates], Picture], states: BodyStates, strides: RampStrides) -> Iterator[Picture]:
    """Yield a picture of each step until it falls; frame: WIDTH x BODY_HEIGHT pixels of a state (nq or more)."""
    strips, place = strips_picture(strides)
    font = ImageFont.load_default(TEXT)
    for step in range(strides.upright):
        body = Image.fromarray(frame(states[step]))
        ImageDraw.Draw(body).text((TEXT, TEXT), strides.now(step), fill=INK, font=font)
        below = strips.copy()
        x = round(place(float(strides.time[step])))
        below[:, max(0, x - 1) : x + 1] = (30, 30, 30)
        yield np.concatenate([np.asarray(body), below], axis=0)


def strips_picture(strides: RampStrides) -> tuple[Picture, Callable[[float], float]]:
    """The strips as pixels (STRIPS_HEIGHT, WIDTH, 3), and from a time, s, to the column where it stands there."""
    figure = Figure(figsize=(WIDTH / DOTS, STRIPS_HEIGHT / DOTS), dpi=DOTS, layout="constrained", facecolor="white")
    canvas: Any = FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 1, height_ratios=(1.5, 1.0, 0.45))
    axes = [figure.add_subplot(grid[row]) for row in range(3)]
    draw_strips(axes, strides)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3].copy()
    transform: Any = axes[0].transData.frozen()
    return pixels, lambda time: float(transform.transform((time, 0.0))[0])


def draw_strips(axes: Sequence[Axes], strides: RampStrides) -> None:
    """Speed, cadence and gait over time in three plots, the time below the last one."""
    end = float(strides.time[-1])
    speed, cadence, gait = axes
    dress(speed, ylabel="speed [m/s]")
    speed.plot(strides.time, strides.asked, **ASKED)
    speed.plot(strides.time, strides.held, color=STUDENT, linewidth=1.8)
    handles = [Line2D([], [], **ASKED), Line2D([], [], color=STUDENT, linewidth=1.8)]
    speed.legend(handles, ["asked", "held (mean over 1 s)"], loc="upper right", fontsize=7, frameon=False)
    dress(cadence, ylabel="strides [1/s]")
    middles = 0.5 * (strides.starts[1:] + strides.starts[:-1])
    cadence.plot(middles, strides.cadence, ".-", color=STUDENT, linewidth=1.0, markersize=3)
    dress(gait, xlabel="time [s]", ylabel="gait")
    for name, start, stop in strides.spans:
        gait.axvspan(start, stop, color=GAIT_COLORS.get(name, FAINT), linewidth=0)
    shown = list(dict.fromkeys(strides.gaits))
    patches = [Patch(color=GAIT_COLORS.get(name, FAINT)) for name in shown]
    if shown:
        gait.legend(patches, shown, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    gait.set_yticks([])
    gait.grid(False)
    for plot in axes:
        plot.set_xlim(0.0, end)
        if strides.fell:
            plot.axvspan(strides.time[strides.upright], end, color=FAINT, alpha=0.5, linewidth=0)
    if strides.fell:
        fallen = (strides.time[strides.upright], 0.5)
        speed.annotate(" fallen", fallen, xycoords=("data", "axes fraction"), fontsize=8, color=INK)
    for plot in (speed, cadence):
        plot.tick_params(labelbottom=False)


def middle(picture: Picture) -> Picture:
    """Where the body is in a picture: as wide as POSE_SHARE of its height."""
    width = round(POSE_SHARE * picture.shape[0])
    left = (picture.shape[1] - width) // 2
    return picture[:, left : left + width]


def pose_steps(strides: RampStrides) -> NDArray[np.int64]:
    """Steps of the poster's poses, evenly spread over the time of the ramp; those after a fall are left out."""
    steps = ((np.arange(POSTER_POSES) + 0.5) / POSTER_POSES * len(strides.time)).astype(np.int64)
    kept = steps[steps < strides.upright]
    return kept if len(kept) else np.array([max(0, strides.upright - 1)])


def ramp_poster(
    strides: RampStrides, pictures: Sequence[Picture] | None, states: BodyStates, segments: BodySegments
) -> Figure:
    """Poses over the strips. pictures: of the states (P, nq or more) of `pose_steps`; None: sticks of `segments`."""
    figure = new_figure(13.0, 5.6)
    grid = figure.add_gridspec(4, POSTER_POSES, height_ratios=(2.6, 1.5, 1.0, 0.45))
    for place, (step, state) in enumerate(zip(pose_steps(strides), states, strict=True)):
        plot = figure.add_subplot(grid[0, place])
        if pictures is not None:
            plot.imshow(pictures[place])
        else:
            draw_sticks(plot, *segments(state))
        plot.set_title(f"{strides.time[step]:.0f} s", fontsize=8, color=INK)
        plot.set_axis_off()
    draw_strips([figure.add_subplot(grid[row, :]) for row in (1, 2, 3)], strides)
    top = float(strides.asked.max())
    title = f"One policy, asked from {strides.asked[0]:g} to {top:g} and back to {strides.asked[-1]:.2g} m/s"
    figure.suptitle(title, fontsize=12, x=0.01, ha="left", color=INK)
    return figure


def draw_sticks(plot: Any, lines: Floats, faint: NDArray[np.bool_]) -> None:
    """A stick figure from the side; lines (S, 2, 2) m, faint (S,)."""
    plot.add_collection(LineCollection(list(lines[faint]), colors=STUDENT, linewidths=1.6, alpha=0.4))
    plot.add_collection(LineCollection(list(lines[~faint]), colors=STUDENT, linewidths=2.2))
    plot.axhline(0.0, color=INK, linewidth=0.8)
    plot.set_xlim(-0.85, 0.85)
    plot.set_ylim(-0.05, 1.95)
    plot.set_aspect("equal")
