"""Statistics over seeds (Agarwal et al. 2021, Deep Reinforcement Learning at the Edge of the Statistical Precipice).

A sample holds one number per seed. Several samples are strata: each is resampled by itself, and the statistic is that
of all resampled numbers together. Intervals are percentile intervals of scipy's bootstrap, of five seeds or more: one
of two to four is little but their smallest and largest value. Which of two is better: romgrl/results/exact_tests.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean

CONFIDENCE = 0.95
RESAMPLES = 9_999
FEWEST_SEEDS = 5  # below, there is no interval and no verdict
SEED = 2021  # of the resampling, so that the same numbers have the same interval

Floats = NDArray[np.float64]
Statistic = Callable[..., Any]


@dataclass(frozen=True)
class Interval:
    """Ends of a confidence interval; both nan where there is none."""

    low: float
    high: float

    @property
    def known(self) -> bool:
        """Tell whether there is one."""
        return math.isfinite(self.low)


@dataclass(frozen=True)
class Summary:
    """One number over the seeds of a cell. `missing`: seeds in which it is not defined; `values` is without them."""

    values: Floats
    missing: int

    @property
    def seeds(self) -> int:
        """All seeds of the cell."""
        return len(self.values) + self.missing

    @property
    def mean(self) -> float:
        """Mean; nan for no values."""
        return float(self.values.mean()) if len(self.values) else math.nan

    @cached_property
    def mean_interval(self) -> Interval:
        """Interval of the mean; none below FEWEST_SEEDS values."""
        return interval([self.values]) if len(self.values) >= FEWEST_SEEDS else NOWHERE

    @property
    def iqm(self) -> float:
        """Interquartile mean; nan for no values."""
        return float(interquartile_mean(self.values))

    @cached_property
    def iqm_interval(self) -> Interval:
        """Interval of the interquartile mean; none below FEWEST_SEEDS values."""
        return interval([self.values], interquartile_mean) if len(self.values) >= FEWEST_SEEDS else NOWHERE

    @property
    def deviation(self) -> float:
        """Sample standard deviation; nan for fewer than two values."""
        return float(self.values.std(ddof=1)) if len(self.values) > 1 else math.nan

    @property
    def smallest(self) -> float:
        """Smallest value; nan for none."""
        return float(self.values.min()) if len(self.values) else math.nan

    @property
    def largest(self) -> float:
        """Largest value; nan for none."""
        return float(self.values.max()) if len(self.values) else math.nan

    @property
    def variation(self) -> float:
        """Coefficient of variation: standard deviation over the size of the mean."""
        return self.deviation / abs(self.mean) if self.mean else math.nan


NOWHERE = Interval(math.nan, math.nan)


def interquartile_mean(values: Floats, axis: int = -1) -> Any:
    """Mean of the middle half: floor(n / 4) of n numbers are cut off at each end; nan for none."""
    return trim_mean(values, 0.25, axis=axis) if values.size else math.nan


def interval(strata: Sequence[Floats], statistic: Statistic = np.mean) -> Interval:
    """95% stratified bootstrap interval of a statistic of the pooled numbers."""
    strata = [np.asarray(stratum, float) for stratum in strata]
    if not strata or min(len(stratum) for stratum in strata) < 2:
        return NOWHERE
    return resampled(strata, lambda *samples, axis: statistic(np.concatenate(samples, axis=axis), axis=axis))


def probability_of_improvement(ours: Floats, theirs: Floats) -> float:
    """P(X > Y) + P(X = Y) / 2 for a seed of each: the Mann-Whitney U statistic over the number of pairs.

    Larger is better; swap the two where smaller is. nan where one of them is empty.
    """
    return float(share_of_wins(np.asarray(ours, float), np.asarray(theirs, float)))


def improvement_interval(ours: Floats, theirs: Floats) -> Interval:
    """95% bootstrap interval of the probability of improvement; both samples are resampled independently.

    None below FEWEST_SEEDS, nor where every resample says the same, as those of samples that do not overlap do.
    """
    samples = [np.asarray(ours, float), np.asarray(theirs, float)]
    if min(map(len, samples)) < FEWEST_SEEDS:
        return NOWHERE
    ends = resampled(samples, lambda x, y, axis: share_of_wins(x, y))
    return NOWHERE if ends.low == ends.high else ends


def share_of_wins(ours: Floats, theirs: Floats) -> Any:
    """Share of pairs (..., N) x (..., M) in which ours is larger, ties half: (...)."""
    if not (ours.shape[-1] and theirs.shape[-1]):
        return math.nan
    differences = ours[..., :, None] - theirs[..., None, :]
    return (0.5 + 0.5 * np.sign(differences)).mean(axis=(-2, -1))


def resampled(samples: Sequence[Floats], statistic: Statistic) -> Interval:
    """Percentile interval of a vectorised statistic of samples that are resampled one by one."""
    ends = bootstrap(
        samples,
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        axis=-1,
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Interval(float(ends.low), float(ends.high))


def summarize(values: Sequence[float]) -> Summary:
    """The numbers of a cell, one per seed; nan stands for a seed in which the number is not defined."""
    everything = np.asarray(values, float)
    known = everything[np.isfinite(everything)]
    return Summary(known, len(everything) - len(known))
