"""Windows of consecutive gait frames, as the discriminator sees them.

A frame is the five features of the contract (romgrl.gait.features), with the trunk inclination as a sixth if wished.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

FRAME_MIRROR = (0, 3, 4, 1, 2, 5)
"""Left-right mirror of a frame: the feet change sides, height and trunk inclination stay."""


def window_mirror(columns: int, window: int) -> tuple[NDArray[np.int64], Float32]:
    """Permutation and sign of a mirrored window of `window` frames of `columns` entries, (window * columns,) each."""
    frame = np.array([c for c in FRAME_MIRROR if c < columns])
    permutation = (np.arange(window)[:, None] * columns + frame).ravel()
    return permutation.astype(np.int64), np.ones(window * columns, dtype=np.float32)


class FrameWindows:
    """The last `window` frames of N environments, oldest first, in one buffer (N, window, columns)."""

    def __init__(self, *, num_envs: int, columns: int, window: int) -> None:
        self.frames = np.zeros((num_envs, window, columns), dtype=np.float32)

    def restart(self, frame: Float32, rows: NDArray[np.bool_] | slice = slice(None)) -> None:
        """Fill the windows of `rows` with their first frame (N, columns)."""
        self.frames[rows] = frame[rows][:, None]

    def push(self, frame: Float32) -> Float32:
        """Append the newest frame (N, columns); returns the windows flat, (N, window * columns), a view."""
        self.frames[:, :-1] = self.frames[:, 1:]
        self.frames[:, -1] = frame
        return self.frames.reshape(len(self.frames), -1)

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
    window: int,
    trunk: bool,
    trunk_std: float,
    mirror: bool,
    seed: int,
) -> Float32:
    """Windows of a reference, (M, window * columns), none of which crosses an episode.

    With `trunk`, each window gets one trunk inclination from N(0, trunk_std): the ROM's trunk is upright. With
    `mirror`, each window is followed by its mirror image.
    """
    starts = np.arange(len(features) - window + 1)
    starts = starts[episode[starts] == episode[starts + window - 1]]
    if len(starts) == 0:
        raise ValueError(f"no episode of the reference holds a window of {window} frames")
    windows = features[starts[:, None] + np.arange(window)]
    if trunk:
        lean = np.random.default_rng(seed).normal(0.0, trunk_std, (len(starts), 1, 1)).astype(np.float32)
        windows = np.concatenate((windows, np.broadcast_to(lean, (len(starts), window, 1))), axis=-1)
    columns = windows.shape[-1]
    flat: Float32 = windows.reshape(len(starts), -1).astype(np.float32)
    if mirror:
        permutation, sign = window_mirror(columns, window)
        flat = np.stack((flat, flat[:, permutation] * sign), axis=1).reshape(2 * len(starts), -1)
    return flat
