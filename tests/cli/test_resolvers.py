"""The speed that a teacher of a range is asked for follows the student's, where the range has it."""

from __future__ import annotations

import pytest

from romgrl.cli.compose import compose_config
from romgrl.cli.resolvers import within


@pytest.mark.parametrize(
    ("teacher", "inside", "otherwise"), [("variable_walking", 1.5, 1.25), ("hopping", 0.0, 1.0), ("skipping", 2.5, 2.0)]
)
def test_the_speed_of_a_range_is_the_students(teacher: str, inside: float, otherwise: float) -> None:
    assert compose_config(f"teacher={teacher}", f"speed={inside}").teacher.speed == inside
    assert compose_config(f"teacher={teacher}").teacher.speed == otherwise


def test_without_limits_the_other_value_is_taken() -> None:
    assert [within(value, [1, 2], 3) for value in (1, 2, 2.1, "x", None)] == [1, 2, 3, 3, 3]
    assert [within(1, limits, 3) for limits in (None, [], "text", [2], [2, 1])] == [3] * 5
