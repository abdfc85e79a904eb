"""Dynamic time warping: what is left between two windows when time may stretch a little.

The symmetric form without slope constraint of Sakoe and Chiba 1978 (IEEE Trans. ASSP 26:43, Table I, P = 0), whose
weights along a path always add up to W + W, so that the time-normalised distance needs no path length:

    g(i, j) = min( g(i, j - 1) + d(i, j),  g(i - 1, j - 1) + 2 d(i, j),  g(i - 1, j) + d(i, j) ),   |i - j| <= r
    DTW = g(W, W) / (2 W),            d(i, j) = sqrt(mean_c ((a[i, c] - b[j, c]) / scale_c)^2)

with g(1, 1) = 2 d(1, 1) and r = 10 % of W. One path serves all channels (Shokoohi-Yekta et al. 2017, Data Min. Knowl.
Disc. 31:1): 10 % of 100 steps at 30 Hz is half a stride, and feet warped apart from each other would make a hop look
like a run.
"""

from __future__ import annotations

import numpy as np

from romgrl.gait.features import Floats

WARPING_BAND = 0.1  # of the window


def warped_distance(windows: Floats, matched: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """DTW (E,), in units of `scale`, of pairs of windows (E, W, C), and its parts (E, C).

    The parts are the mean of |a - b| of each channel along the path that is best for all, weighted like the distance,
    in the unit of the channel. scale: (C,).
    """
    episodes, length, channels = windows.shape
    reach = max(1, round(WARPING_BAND * length))
    sums = np.full((2, length, episodes, channels + 1), np.inf)  # two rows of g, then the channels' sums on its path
    for i in range(length):
        low, high = max(0, i - reach), min(length, i + reach + 1)
        row, above = sums[i % 2], sums[(i - 1) % 2]
        row[:] = np.inf
        costs = _costs(windows[:, i], matched[:, low:high], scale)
        for j, cost in zip(range(low, high), costs, strict=True):
            row[j] = _extend(i, j, cost, row, above)
    total = sums[(length - 1) % 2, -1] / (2 * length)
    return total[:, 0], total[:, 1:]


def _costs(frame: Floats, others: Floats, scale: Floats) -> Floats:
    """d and |a - b| per channel of one frame (E, C) against each of (E, J, C): (J, E, 1 + C)."""
    apart = np.abs(frame[:, None] - others)
    together = np.sqrt(((apart / scale) ** 2).mean(axis=-1, keepdims=True))
    return np.concatenate((together, apart), axis=-1).transpose(1, 0, 2)


def _extend(i: int, j: int, cost: Floats, row: Floats, above: Floats) -> Floats:
    """The best sums (E, 1 + C) up to (i, j)."""
    if i == j == 0:
        return 2 * cost
    best = np.full_like(cost, np.inf)
    steps = ((i and j, above[j - 1], 2), (j, row[j - 1], 1), (i, above[j], 1))  # diagonal first: it wins ties
    for allowed, before, weight in steps:
        if allowed:
            sums = before + weight * cost
            best = np.where(sums[:, :1] < best[:, :1], sums, best)
    return best
