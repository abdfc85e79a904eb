"""Which of its checks over a grid of cells a student is kept by: learning and card go by the same rule."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

WORST = 0.2
"""Share of the cells that a policy is judged by: those where it is worst."""


def worst_fifth(shortfalls: Sequence[float]) -> float:
    """Mean of the largest fifth of what the cells are short of, of one at least."""
    return fmean(sorted(shortfalls, reverse=True)[: max(1, round(WORST * len(shortfalls)))])


def kept_check(scores: Sequence[float], kept_policy: str) -> int:
    """Number of the check whose policy is kept: with `last` the last one, else the first of the least `worst_fifth`."""
    return len(scores) - 1 if kept_policy == "last" else min(range(len(scores)), key=scores.__getitem__)
