"""Statistics over seeds against closed forms, scipy and brute force."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy import stats

from romgrl.results import statistics
from romgrl.results.statistics import (
    improvement_interval,
    interquartile_mean,
    interval,
    probability_of_improvement,
    summarize,
)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([7.0], 7.0),
        ([1.0, 2.0, 9.0], 4.0),  # fewer than four: nothing is cut off
        ([0.0, 1.0, 3.0, 100.0], 2.0),
        ([-50.0, 1.0, 2.0, 6.0, 100.0], 3.0),
        ([8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0], 4.5),
    ],
)
def test_the_interquartile_mean_is_that_of_the_middle_half(values: list[float], expected: float) -> None:
    assert interquartile_mean(np.array(values)) == pytest.approx(expected)


def test_the_interval_is_that_of_all_equally_likely_resamples() -> None:
    sample = [1.0, 2.0, 4.0, 8.0]
    means = [np.mean(resample) for resample in product(sample, repeat=4)]  # all 256, no draw of chance
    exact = np.quantile(means, [0.025, 0.975])
    found = interval([np.array(sample)])
    assert (found.low, found.high) == pytest.approx(tuple(exact), abs=0.26)  # a step of the mean is 1/4
    assert found == interval([np.array(sample)])  # the same numbers, the same interval


def test_strata_are_resampled_by_themselves() -> None:
    apart = [np.array([0.0, 0.0, 0.0]), np.array([10.0, 10.0, 10.0])]
    assert interval(apart) == statistics.Interval(5.0, 5.0)  # no resample mixes the two
    together = interval([np.concatenate(apart)])
    assert together.low < 3
    assert together.high > 7


def test_one_seed_has_no_interval() -> None:
    summary = summarize([3.0])
    assert (summary.seeds, summary.missing, summary.mean, summary.iqm) == (1, 0, 3.0, 3.0)
    assert math.isnan(summary.mean_interval.low)
    assert math.isnan(summary.deviation)
    assert math.isnan(interval([np.array([1.0, 2.0]), np.array([1.0])]).low)


def test_fewer_than_five_seeds_have_no_interval() -> None:
    assert not summarize([1.0, 2.0, 3.0, 4.0]).mean_interval.known
    assert not summarize([1.0, 2.0, 3.0, 4.0, math.nan]).iqm_interval.known
    found = summarize([1.0, 2.0, 3.0, 4.0, 5.0])
    assert found.mean_interval == interval([found.values])
    assert found.mean_interval.known


def test_a_number_that_a_seed_does_not_have_is_counted_and_left_out() -> None:
    summary = summarize([1.0, math.nan, 3.0])
    assert (summary.seeds, summary.missing, summary.mean) == (3, 1, 2.0)
    assert (summary.smallest, summary.largest) == (1.0, 3.0)
    assert summary.deviation == pytest.approx(math.sqrt(2))
    assert summary.variation == pytest.approx(math.sqrt(2) / 2)
    nothing = summarize([math.nan])
    assert (nothing.seeds, nothing.missing) == (1, 1)
    assert math.isnan(nothing.mean)
    assert math.isnan(nothing.iqm)


@pytest.mark.parametrize("seed", range(3))
def test_the_probability_of_improvement_is_mann_whitney_u_over_all_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ours, theirs = rng.integers(0, 5, 6).astype(float), rng.integers(0, 5, 4).astype(float)  # with ties
    found = probability_of_improvement(ours, theirs)
    assert found == pytest.approx(stats.mannwhitneyu(ours, theirs).statistic / 24)
    assert found == pytest.approx(np.mean([(x > y) + 0.5 * (x == y) for x in ours for y in theirs]))
    assert probability_of_improvement(theirs, ours) == pytest.approx(1 - found)


def test_an_improvement_has_an_interval_where_seeds_disagree() -> None:
    better, worse = np.arange(10.0, 15.0), np.arange(5.0)
    assert not improvement_interval(better, worse).known  # each resample says 1: no interval
    mixed = improvement_interval(np.array([1.0, 4.0, 6.0, 7.0, 10.0]), np.array([2.0, 3.0, 5.0, 8.0, 9.0]))
    assert mixed.low < 0.5 < mixed.high
    assert not improvement_interval(np.array([1.0, 4.0, 6.0, 7.0]), np.array([2.0, 3.0, 5.0, 8.0])).known
    assert not improvement_interval(better, worse[:1]).known
    assert math.isnan(probability_of_improvement(better, np.array([])))


@pytest.mark.parametrize(("seeds", "coverage"), [(3, 0.74), (5, 0.83), (20, 0.92)])
def test_coverage_of_the_mean_of_normal_numbers(seeds: int, coverage: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """How often the interval holds the true mean: less often than 95% with few seeds; docs/method.md says so."""
    monkeypatch.setattr(statistics, "RESAMPLES", 499)
    samples = np.random.default_rng(0).normal(size=(400, seeds))
    found = [interval([sample]) for sample in samples]
    held = np.mean([each.low <= 0 <= each.high for each in found])
    assert held == pytest.approx(coverage, abs=0.05)  # 2.5 standard errors of 400 trials
