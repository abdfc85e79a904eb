"""Seeds that chose the settings stand apart from held-out ones."""

from __future__ import annotations

from romgrl.results.seed_groups import CHOSEN, HELD_OUT, by_group, held_out_or_all, seeds_told


def test_held_out_seeds_come_first_and_alone() -> None:
    seeds = [0, 4, 5, 11]
    assert by_group(seeds, lambda seed: seed) == {HELD_OUT: [5, 11], CHOSEN: [0, 4]}
    assert [*by_group(seeds, lambda seed: seed)] == [HELD_OUT, CHOSEN]
    assert held_out_or_all(seeds, lambda seed: seed) == [5, 11]
    assert held_out_or_all([0, 1], lambda seed: seed) == [0, 1]
    assert by_group(["a", "b"], lambda item: None) == {"": ["a", "b"]}
    assert held_out_or_all(["a", "b"], lambda item: None) == ["a", "b"]


def test_seeds_are_told() -> None:
    assert seeds_told([1, 0]) == "seeds 0, 1 (chose the settings)"
    assert seeds_told([7, 0, 6]) == "seeds 6, 7 (held out) and seed 0 (chose the settings)"
