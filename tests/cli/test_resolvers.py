"""The speed that a teacher of a range is asked for follows the student's, as far as the range goes."""

from __future__ import annotations

import pytest

from romgrl.cli.compose import compose_config
from romgrl.cli.resolvers import nearest


@pytest.mark.parametrize(
    ("teacher", "asked", "taught"),
    [
        ("variable_walking", 1.5, 1.5),
        ("variable_walking", 1.51, 1.5),
        ("variable_walking", 0.0, 0.75),
        ("skipping", 4.0, 2.5),
    ],
)
def test_the_speed_of_a_range_is_the_students(teacher: str, asked: float, taught: float) -> None:
    assert compose_config(f"teacher={teacher}", f"speed={asked}").teacher.speed == taught


def test_it_follows_another_range_and_gives_way_to_a_speed_of_its_own() -> None:
    assert compose_config("teacher=hopping", "teacher.speeds=[1,2]", "speed=3").teacher.speed == 2.0
    assert compose_config("teacher=hopping", "speed=2", "teacher.speed=1").teacher.speed == 1.0


def test_without_limits_the_value_stays() -> None:
    assert [nearest(value, [1, 2]) for value in (0, 1, 1.5, 2, 2.1)] == [1, 1, 1.5, 2, 2]
    assert [nearest(3, limits) for limits in (None, [], "text", [2])] == [3] * 4
    assert nearest("x", [1, 2]) == "x"
