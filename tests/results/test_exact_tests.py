"""Exact tests over seeds, counted by hand and held equal to scipy; Holm's correction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import permutation_test

from romgrl.results import exact_tests
from romgrl.results.exact_tests import holm, paired_p, unpaired_p


@pytest.mark.parametrize(
    ("differences", "p"),
    [
        ([1.0, 2.0, 3.0, 4.0, 5.0], 1 / 32),  # all of one sign: only that pattern is as large; no p of five is smaller
        ([2.0, 1.0, -1.0], 3 / 8),  # sums 4 2 2 0 0 -2 -2 -4; found 2, with a tie
        ([1.0, -1.0], 3 / 4),  # sums 2 0 0 -2; found 0
        ([0.1, 0.2, -0.3], 5 / 8),  # a sum that is zero but for the last bit, and its tie with the other sign
        ([-1.0, -2.0], 1.0),
        ([0.0, 0.0, 0.0], 1.0),
        ([1.0, math.nan, 1.0], 1 / 4),  # a pair without a number does not count
    ],
)
def test_the_paired_p_counts_all_signs(differences: list[float], p: float) -> None:
    assert paired_p(differences, [0.0] * len(differences)) == p
    assert paired_p(np.add(differences, 0.3).tolist(), [0.3] * len(differences)) == p


@pytest.mark.parametrize(
    ("ours", "theirs", "p"),
    [
        ([4.0, 5.0, 6.0], [1.0, 2.0, 3.0], 1 / 20),
        ([1.0, 4.0], [2.0, 3.0], 4 / 6),  # sums of pairs 3 4 5 5 6 7; found 5, with a tie
        ([0.1, 0.1, 0.1], [0.1, 0.1], 1.0),
        ([2.0, math.nan, 3.0], [1.0, 0.0], 1 / 6),
        ([10.0, 11.0, 12.0, 13.0, 14.0], [5.0, 6.0, 7.0, 8.0, 9.0], 1 / 252),
    ],
)
def test_the_unpaired_p_counts_all_splits(ours: list[float], theirs: list[float], p: float) -> None:
    assert unpaired_p(ours, theirs) == pytest.approx(p)


def test_one_number_has_no_p() -> None:
    assert math.isnan(paired_p([1.0, math.nan], [0.0, 0.0]))
    assert math.isnan(unpaired_p([1.0, 2.0], [0.0]))


def mean_difference(first: np.ndarray, second: np.ndarray | None = None, axis: int = -1) -> np.ndarray:
    """The statistic of both tests."""
    return first.mean(axis=axis) - (0 if second is None else second.mean(axis=axis))


@pytest.mark.parametrize("seed", range(3))
def test_scipys_exact_tests_say_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ours, theirs = rng.normal(0.3, 1.0, 5), rng.normal(0.0, 1.0, 5)
    options = {"n_resamples": np.inf, "alternative": "greater"}
    paired = permutation_test((ours - theirs,), mean_difference, permutation_type="samples", **options)
    assert len(paired.null_distribution) == 32  # every sign, once
    assert paired_p(ours.tolist(), theirs.tolist()) == pytest.approx(paired.pvalue)
    split = permutation_test((ours, theirs), mean_difference, permutation_type="independent", **options)
    assert len(split.null_distribution) == 252
    assert unpaired_p(ours.tolist(), theirs.tolist()) == pytest.approx(split.pvalue)


def test_too_many_to_count_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = [1.0, 3.0, 2.0, 5.0, 2.5], [0.5, 3.5, 1.0, 1.0, 2.0]
    counted = paired_p(ours, theirs), unpaired_p(ours, theirs)
    monkeypatch.setattr(exact_tests, "EXACT", 16)
    monkeypatch.setattr(exact_tests, "DRAWN", 31)  # fewer than the 32 and 252 that scipy could count
    drawn = paired_p(ours, theirs), unpaired_p(ours, theirs)
    assert drawn != counted
    assert drawn == pytest.approx(counted, abs=0.25)  # 2.5 standard errors of 31 draws and more


def test_holm() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])  # 3 x 0.01, 2 x 0.03, and no smaller
    assert holm([1 / 32, math.nan, 0.5]) == pytest.approx([1 / 16, math.nan, 0.5], nan_ok=True)
    assert holm([0.4, 0.9]) == pytest.approx([0.8, 0.9])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []
