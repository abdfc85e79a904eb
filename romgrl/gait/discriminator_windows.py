"""Windows of gait frames, as the discriminator sees them.

A frame is the five features of the contract (romgrl.gait.features), with the trunk inclination as a sixth, and behind
it the heights of both soles or the velocities of the five, if wished. The frames of a window lie `stride` control steps
apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import BODY_Y, CHANNELS, LEFT_Z, MIRROR, RIGHT_Z
from romgrl.gait.symmetry import Mirror, unsigned

Float32 = NDArray[np.float32]
SOLE_RANGE = np.float32(0.005), np.float32(0.03)
"""Heights of a sole, m, from the least to the most that is told apart: below, soft soles are pressed together, which
the ROM's are not; above, a foot is clear of the ground, however it is turned."""


@dataclass(frozen=True)
class WindowLayout:
    """What a window holds: `window` frames, oldest first, `stride` control steps of `dt` seconds apart.

    features: "paper": the five; "velocities": the five and their velocities; "trunk": the five and the trunk
    inclination; "trunk_soles": with them the heights of both soles, within SOLE_RANGE;
    "trunk_velocities": the five, the trunk inclination, the velocities of the five. A velocity is the difference from
    the control step before over dt, in m/s; the trunk has none, because the ROM's does not turn.
    """

    features: str
    window: int
    stride: int = 1
    dt: float = 1.0

    @property
    def trunk(self) -> bool:
        """True where a frame has the trunk inclination."""
        return self.features.startswith("trunk")

    @property
    def soles(self) -> bool:
        """True where a frame has the heights of the soles."""
        return self.features.endswith("soles")

    @property
    def velocities(self) -> bool:
        """True where a frame has velocities."""
        return self.features.endswith("velocities")

    @property
    def positions(self) -> int:
        """Columns of a control step as it is recorded."""
        return len(CHANNELS) + self.trunk + 2 * self.soles

    @property
    def columns(self) -> int:
        """Columns of a frame of the window."""
        return self.positions + len(CHANNELS) * self.velocities

    @property
    def size(self) -> int:
        """Entries of a window."""
        return self.window * self.columns

    @property
    def span(self) -> int:
        """Control steps in a row that a window is made of."""
        return (self.window - 1) * self.stride + 1 + self.velocities

    def frame(self, info: Mapping[str, Float32], prefix: str = "") -> Float32:
        """A control step (N, positions) from an environment's `info`; prefix "reset_" for the one after a reset."""
        parts = [info[f"{prefix}features"]]
        parts += [info[f"{prefix}trunk_lean"]] if self.trunk else []
        parts += [info[f"{prefix}sole_height"].clip(*SOLE_RANGE)] if self.soles else []
        return np.column_stack(parts)

    def windows(self, steps: Float32) -> Float32:
        """Windows (N, size) of recorded control steps (N, span, positions); a view where nothing is left out."""
        frames = steps[:, int(self.velocities) :: self.stride]
        if self.velocities:
            before, now = steps[:, : -1 : self.stride, : len(CHANNELS)], frames[..., : len(CHANNELS)]
            frames = np.concatenate((frames, (now - before) / np.float32(self.dt)), axis=-1)
        return frames.reshape(len(steps), self.size)

    def weights(self, sole_weight: float) -> Float32:
        """Factors (size,) of a window's columns: those of the soles have `sole_weight`, all others 1."""
        frame = np.ones(self.columns, np.float32)
        frame[len(CHANNELS) + self.trunk : self.positions] = sole_weight
        return np.tile(frame, self.window)

    def mirror(self) -> Mirror:
        """Mirror of a window (size,); all that is seen keeps its sign."""
        frame = [*MIRROR.permutation]
        frame += [len(frame)] * self.trunk
        frame += [len(frame) + 1, len(frame)] * self.soles
        frame += [len(frame) + column for column in MIRROR.permutation] * self.velocities
        return unsigned((np.arange(self.window)[:, None] * self.columns + np.array(frame)).ravel())


class FrameWindows:
    """The last control steps of N environments, oldest first, in one buffer (N, span, positions)."""

    def __init__(self, *, num_envs: int, layout: WindowLayout) -> None:
        self.layout = layout
        self.frames = np.zeros((num_envs, layout.span, layout.positions), dtype=np.float32)

    def frame(self, info: Mapping[str, Float32], prefix: str = "") -> Float32:
        """As the layout's."""
        return self.layout.frame(info, prefix)

    def restart(self, frame: Float32, rows: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Fill the windows of `rows` with their first step (N, positions), as if they had stood there."""
        self.frames[rows] = frame[rows][:, None]

    def push(self, frame: Float32) -> Float32:
        """Append the newest step (N, positions); returns the windows (N, size), maybe a view."""
        self.frames[:, :-1] = self.frames[:, 1:]
        self.frames[:, -1] = frame
        return self.layout.windows(self.frames)

    def state(self) -> dict[str, Float32]:
        """Everything that `restore` needs."""
        return {"frames": self.frames}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.frames[:] = state["frames"]


def reference_windows(
    features: Float32,
    episode: NDArray[np.int32],
    *,
    layout: WindowLayout,
    trunk_std: float,
    mirror: bool,
    seed: int,
    trunk_time: float | None = None,
) -> Float32:
    """Windows of a reference, (M, layout.size), none of which crosses an episode.

    With the trunk, each window gets inclinations of its own (`trunk_leans`): the ROM's trunk is upright. The soles of
    its feet, which do not turn, are at the ground where the ankles are lowest. With `mirror`, each window is followed
    by its mirror image, which leans as it does.
    """
    span = layout.span
    starts = np.arange(len(features) - span + 1)
    starts = starts[episode[starts] == episode[starts + span - 1]]
    if len(starts) == 0:
        raise ValueError(f"no episode of the reference holds a window of {span} steps")
    steps = features[starts[:, None] + np.arange(span)]
    if layout.trunk:
        lean = trunk_leans(len(starts), span, std=trunk_std, time=trunk_time, dt=layout.dt, seed=seed)
        steps = np.concatenate((steps, lean[..., None]), axis=-1)
    if layout.soles:
        ankles = steps[..., [LEFT_Z, RIGHT_Z]] + steps[..., [BODY_Y]]
        steps = np.concatenate((steps, (ankles - ankles.min()).clip(*SOLE_RANGE)), axis=-1)
    flat = layout.windows(steps.astype(np.float32))
    if mirror:
        flat = np.stack((flat, layout.mirror().image(flat)), axis=1).reshape(2 * len(starts), -1)
    return flat


def trunk_leans(count: int, span: int, *, std: float, time: float | None, dt: float, seed: int) -> Float32:
    """Inclinations of the trunk (count, span) in rad, `dt` seconds apart along `count` windows that are independent.

    Each is a stretch of a smooth stationary Gaussian process: N(0, std) at every step, and exp(-(lag / time)^2) is the
    correlation between two steps, so that the lean rate has a standard deviation of sqrt(2) std / time. time: seconds
    after which the correlation is 1/e; None: without end, one inclination for all of a window.
    """
    random = np.random.default_rng(seed)
    if time is None:
        lean = random.normal(0.0, std, (count, 1)).astype(np.float32)
        return np.broadcast_to(lean, (count, span))
    lag = dt * np.subtract.outer(np.arange(span), np.arange(span))
    covariance = std**2 * np.exp(-((lag / time) ** 2))
    return random.multivariate_normal(np.zeros(span), covariance, count).astype(np.float32)
