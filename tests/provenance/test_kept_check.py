"""The check that a student is kept by has the least mean over its worst fifth of the cells, or is the last one."""

from __future__ import annotations

from romgrl.provenance.kept_check import kept_check, worst_fifth


def test_a_policy_is_judged_by_the_worst_fifth_of_the_cells() -> None:
    assert worst_fifth([1.0, 5.0, 2.0, 3.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0]) == 7.0
    assert worst_fifth([1.0, 2.0]) == 2.0


def test_the_first_of_the_best_is_kept_or_the_last_one() -> None:
    assert kept_check([3.0, 1.0, 2.0, 1.0], "reference") == 1
    assert kept_check([3.0, 1.0, 2.0], "last") == 2
