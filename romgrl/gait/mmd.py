"""Maximum mean discrepancy between gaits, and whether it could be chance.

    MMD^2(P, Q) = E k(x, x') + E k(y, y') - 2 E k(x, y),     k(a, b) = exp(-|a - b|^2 / (2 sigma^2))

It is zero only where both distributions are the same (Gretton et al. 2012, JMLR 13:723, Theorem 5).

A point is a run of SPAN frames of one episode, five channels each, standardised by the teacher: a single frame does not
tell a slow cadence from a fast one. sigma is the median distance between points of the teacher, the same whoever is
scored, so that the values can be compared.

Frames of one episode are alike because they follow each other. The unit is therefore the block, one window of one
episode: expectations over independent x, x' are means over pairs from different blocks, which is the unbiased
estimator (their eq. 3) of the kernel between blocks, K(A, B) = mean of k(a, b) over a in A and b in B (Muandet et al.
2012, NIPS 25), and the permutation test exchanges whole blocks, never frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from romgrl.gait.features import Floats

SPAN = 4  # frames of a point: 0.1 s at 30 Hz
MOST_BLOCKS = 100  # of one walker; the time grows with the square
POINTS_FOR_BANDWIDTH = 1000
PERMUTATIONS = 2000


def points(windows: Floats) -> Floats:
    """Runs of SPAN frames within each window: (B, W, C) to (B, W - SPAN + 1, C SPAN)."""
    runs = np.lib.stride_tricks.sliding_window_view(windows, SPAN, axis=1)
    return np.asarray(runs.reshape(*runs.shape[:2], -1))


def median_distance(blocks: Floats) -> float:
    """Median distance between different points of (B, P, D), at most POINTS_FOR_BANDWIDTH of them, evenly spread."""
    flat = blocks.reshape(-1, blocks.shape[-1])
    flat = flat[:: max(1, -(-len(flat) // POINTS_FOR_BANDWIDTH))]
    above = np.triu_indices(len(flat), 1)
    return float(np.sqrt(np.median(_squared_distances(flat, flat)[above]))) if len(flat) > 1 else float("nan")


def block_kernel(blocks: Floats, bandwidth: float) -> Floats:
    """K (B, B): the mean of k over all pairs of points of two blocks; blocks (B, P, D)."""
    flat = blocks.reshape(-1, blocks.shape[-1])
    rows = [np.exp(-_squared_distances(block, flat) / (2 * bandwidth**2)).mean(axis=0) for block in blocks]
    return np.asarray(np.stack(rows).reshape(len(blocks), len(blocks), -1).mean(axis=2))


def mmd_squared(kernel: Floats, first: Floats) -> Floats:
    """Unbiased MMD^2 of each split (S, B) of the blocks into first (1) and second (0), at least two in each: (S,).

    It can be below zero where the distributions are the same.
    """
    second = 1.0 - first
    m, n = first.sum(axis=1), second.sum(axis=1)
    diagonal = np.diag(kernel)
    within_first = ((first @ kernel) * first).sum(axis=1) - first @ diagonal
    within_second = ((second @ kernel) * second).sum(axis=1) - second @ diagonal
    between = ((first @ kernel) * second).sum(axis=1)
    return np.asarray(within_first / (m * (m - 1)) + within_second / (n * (n - 1)) - 2 * between / (m * n))


def mmd_test(windows: Floats, teacher: Floats, bandwidth: float, seed: int) -> tuple[float, float]:
    """MMD^2 of standardised windows (M, W, C) and (N, W, C), and the share of splits into M and N with no less.

    p = (1 + splits at least as far apart) / (1 + PERMUTATIONS); Phipson and Smyth 2010, Stat. Appl. Genet. Mol. Biol.
    9:39. nan where one side has fewer than two windows or all points are one.
    """
    sides = [side[:MOST_BLOCKS] for side in (windows, teacher)]
    m, n = map(len, sides)
    if min(m, n) < 2 or not bandwidth > 0:
        return float("nan"), float("nan")
    kernel = block_kernel(points(np.concatenate(sides)), bandwidth)
    own = (np.arange(m + n) < m).astype(float)
    shuffled = np.random.default_rng(seed).permuted(np.tile(own, (PERMUTATIONS, 1)), axis=1)
    found, chance = mmd_squared(kernel, own[None])[0], mmd_squared(kernel, shuffled)
    as_far = np.count_nonzero(chance >= found - 1e-12)
    return float(found), (1 + as_far) / (1 + PERMUTATIONS)


def mmd_to_each(windows: Floats, references: Sequence[Floats], bandwidth: float) -> Floats:
    """MMD^2 (C,) of standardised windows (M, W, C') from those of each of C references (N, W, C'), at most MOST_BLOCKS.

    nan where one side has fewer than two windows or all points are one.
    """
    if len(windows) < 2 or not bandwidth > 0:
        return np.full(len(references), np.nan)
    own = points(windows[:MOST_BLOCKS])
    within = _within(own, bandwidth)
    found = []
    for reference in references:
        other = points(reference[:MOST_BLOCKS])
        distances = _squared_distances(*(side.reshape(-1, side.shape[-1]) for side in (own, other)))
        between = float(np.exp(-distances / (2 * bandwidth**2)).mean())
        found.append(within + _within(other, bandwidth) - 2 * between if len(other) > 1 else np.nan)
    return np.array(found)


def _within(blocks: Floats, bandwidth: float) -> float:
    """Mean of k over pairs of points from different blocks (B, P, D)."""
    kernel, count = block_kernel(blocks, bandwidth), len(blocks)
    return float((kernel.sum() - np.trace(kernel)) / max(1, count * (count - 1)))


def _squared_distances(a: Floats, b: Floats) -> Floats:
    """(len(a), len(b)); |a - b|^2 = |a|^2 - 2 a.b + |b|^2, not below zero by rounding."""
    squared = (a**2).sum(axis=1)[:, None] - 2 * a @ b.T + (b**2).sum(axis=1)
    return np.asarray(np.maximum(squared, 0.0))
