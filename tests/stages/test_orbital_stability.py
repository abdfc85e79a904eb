"""Multipliers of a teacher: recovered where they are known, and no number where there is no gait."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from romgrl.rom.parameters import SpringLegParameters, VariableLegParameters
from romgrl.rom.return_map import FOOT, SIDES, Crossing, StrideMap, Walkers
from romgrl.stages.rollouts import orbital_stability
from romgrl.stages.rollouts.orbital_stability import free_coordinates, teacher_multipliers
from tests.helpers.scissors import scissors


class Linear:
    """Strides y' = A y + dither of a clock that shifts with y and never comes back; the right foot stands.

    The clock is in `action`, which a disturbance leaves alone. Coordinates are in units of `scales`.
    """

    names = StrideMap(scissors, SpringLegParameters(), speed=4.0, control_frequency=30.0).names
    scales = np.linspace(0.5, 3.0, len(names))
    stroke = ()

    def __init__(self, largest: complex, falls_above: float = np.inf) -> None:
        rng = np.random.default_rng(0)
        size = len(self.names)
        self.matrix = np.zeros((size, size))
        free = free_coordinates(cast(StrideMap, self), np.array([[False, True]]), np.zeros((1, size)))
        block = np.diag(np.linspace(0.5, 0.0, int(free.sum())))
        turn = np.array([[largest.real, largest.imag], [-largest.imag, largest.real]])
        block[:2, :2] = turn if largest.imag else np.diag([largest.real, 0.5])
        basis = np.eye(len(block)) + 0.3 * rng.standard_normal(block.shape) / np.sqrt(len(block))
        self.matrix[np.ix_(free, free)] = basis @ block @ np.linalg.inv(basis)
        self.shift = 0.1 * rng.standard_normal(size) * free
        self.dither = 0.05 * rng.standard_normal(size) * free
        self.falls_above = falls_above

    def settled(self, worlds: int, *, strides: int, seed: int) -> Crossing:
        rng = np.random.default_rng(seed)
        walkers = Walkers(
            np.zeros((worlds, len(self.names))), np.zeros(worlds, np.int64), rng.uniform(0, 1, (worlds, 2))
        )
        for _ in range(strides):
            crossing = self.walk(walkers)
            walkers = crossing.walkers
        return crossing

    def disturbed(self, walkers: Walkers, offsets: Any) -> Walkers:
        return Walkers(walkers.states + offsets / self.scales, walkers.elapsed, walkers.action)

    def walk(self, walkers: Walkers, *, strides: int = 1) -> Crossing:
        assert strides == 1
        phase = walkers.action
        wave = np.sin(2 * np.pi * phase[:, :1])
        states = walkers.states @ self.matrix.T + wave * self.dither
        phase = phase + 0.618 + (walkers.states @ self.shift)[:, None]
        fell = np.abs(states).max(axis=1) > self.falls_above
        coordinates = np.where(fell[:, None], np.nan, states * self.scales)
        contact = np.tile([False, True], (len(states), 1))
        return Crossing(coordinates, Walkers(states, walkers.elapsed, phase), contact, np.where(fell, np.nan, 0.5))


@pytest.mark.parametrize(
    ("largest", "verdict"), [(0.9, "stable"), (-0.8, "stable"), (1.1, "unstable"), (0.6 + 0.6j, "stable")]
)
def test_known_multipliers_through_a_clock_that_drifts(largest: complex, verdict: str) -> None:
    table = teacher_multipliers(cast(StrideMap, Linear(complex(largest))))
    one, many = table[table.strides == 1], table[table.strides == 8]
    size = len(Linear.names) - len(FOOT)
    expected = np.sort(np.abs(np.linalg.eigvals(Linear(complex(largest)).matrix)))[::-1][:size]
    np.testing.assert_allclose(one.modulus, expected, atol=1e-6)
    assert many.modulus.iloc[0] == pytest.approx(abs(largest), abs=0.01)
    assert len(many) == (2 if complex(largest).imag else 1)
    assert set(table.verdict) == {verdict}
    assert set(table.fell) == {0}
    assert orbital_stability.verdict(table).endswith(f"over 8 strides: {verdict}")


def test_no_gait_is_said() -> None:
    for stride in (cast(StrideMap, Linear(0.9 + 0j, falls_above=0.0)), real_strides()):
        table = teacher_multipliers(stride, worlds=8)
        assert (len(table), table.verdict[0], table.fell[0]) == (1, "no gait", 8)
        assert np.isnan(table.modulus[0])


def real_strides() -> StrideMap:
    """Of a policy that never makes twelve."""
    parameters = SpringLegParameters(engine="native")
    return StrideMap(lambda o: np.zeros((len(o), 2), np.float32), parameters, speed=4.0, control_frequency=30.0)


def test_a_foot_that_ever_stands_is_left_alone() -> None:
    nowhere = np.zeros((2, len(real_strides().names)))
    free = free_coordinates(real_strides(), np.array([[False, False], [False, True]]), nowhere)
    left_out = np.array(real_strides().names)[~free].tolist()
    assert left_out == [f"{SIDES[1]}_foot_{name}" for name in FOOT]


def test_a_motor_at_an_end_of_its_stroke_is_left_alone() -> None:
    """A leg that is as short as its motor makes it in one of two worlds cannot be made shorter, and comes back."""
    parameters = VariableLegParameters(engine="native")
    stride = StrideMap(
        lambda o: np.zeros((len(o), 4), np.float32), parameters, speed=4.0, control_frequency=30.0, top=True
    )
    assert stride.stroke == pytest.approx((-0.05 * parameters.leg_length, 0.05 * parameters.leg_length))
    coordinates = np.zeros((2, len(stride.names)))
    assert free_coordinates(stride, np.zeros((2, 2), bool), coordinates).all()
    coordinates[1, stride.names.index("right_extension")] = stride.stroke[0]
    free = free_coordinates(stride, np.zeros((2, 2), bool), coordinates)
    assert np.array(stride.names)[~free].tolist() == ["right_extension", "right_extension_rate"]
