"""How the weight of the task follows the checks of a gait."""

import math

import pytest

from romgrl.stages.training.adapted_eta import adapted, another_stride, least_eta


def test_the_weight_of_the_task_follows_what_is_wrong() -> None:
    """More where the speed is too low alone or wrong with the cadence, less where it is too high alone or the cadence
    is wrong; not after falls."""

    def at(speed: float, cadence: float, *, fell: bool = False) -> float:
        return adapted(0.35, {"speed_error_percent": speed, "cadence_error_percent": cadence}, fell=fell)

    more, less = pytest.approx(0.35 * 1.15), pytest.approx(0.35 / 1.1)
    assert (at(0.0, 0.0), at(-2.0, 4.0), at(-20.0, -20.0, fell=True)) == (0.35, 0.35, 0.35)
    assert (at(-10.0, -6.0), at(10.0, 12.0), at(-4.0, 0.0), at(-8.0, 4.0)) == (more, more, more, more)
    assert (at(-10.0, 6.0), at(5.0, -8.0), at(2.0, 6.0), at(0.0, -9.0)) == (less, less, less, less)
    assert (at(4.0, 0.0), at(8.0, 4.0), at(4.0, -4.0)) == (less, less, less)
    assert (at(14.0, 38.0), at(-10.0, -16.0)) == (less, less)
    assert (at(-10.0, math.nan), at(0.0, math.nan), at(10.0, math.nan)) == (less, less, less)
    assert at(-60.0, 100.0) == pytest.approx(0.35 * 1.5)
    slow = {"speed_error_percent": -10.0, "cadence_error_percent": -10.0}
    assert (adapted(0.69, slow, fell=False), adapted(0.9, slow, fell=False)) == (0.7, 0.9)


@pytest.mark.parametrize(
    ("first", "share", "least"),
    [(0.3, 0.0, 0.3), (0.3, 0.32, 0.3), (0.3, 0.46, 0.4), (0.3, 0.6, 0.5), (0.3, 1.0, 0.5), (0.8, 0.4, 0.5)],
)
def test_the_weight_of_the_task_does_not_fall_below(first: float, share: float, least: float) -> None:
    assert least_eta(first, share) == pytest.approx(least)


@pytest.mark.parametrize(
    ("speed", "cadence", "another"),
    [
        (0.0, 0.0, False),
        (0.0, 6.0, True),
        (10.0, 12.0, False),  # follows from the speed
        (10.0, 17.0, True),
        (-4.0, 11.0, True),
        (-14.5, -10.2, False),
        (2.0, 5.5, True),
        (-10.0, math.nan, True),  # no strides
    ],
)
def test_a_cadence_that_does_not_follow_from_the_speed_is_another_stride(
    speed: float, cadence: float, another: bool
) -> None:
    assert another_stride({"speed_error_percent": speed, "cadence_error_percent": cadence}) == another
