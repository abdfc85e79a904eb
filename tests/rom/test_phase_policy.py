"""The controller with a clock: its curves, its symmetry, and that it remembers nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.recording import record
from romgrl.rom.gait_clocks import CLOCKS, RUN
from romgrl.rom.phase_policy import COLUMNS, PhasePolicy, Span, between, knot_shares
from romgrl.rom.vector_env import VariableLegVectorEnv


@pytest.fixture(scope="module")
def seen() -> NDArray[np.float32]:
    """Observations (300, 28) on the way of the first controller, from touchdowns and flights of both legs."""
    env, kept = VariableLegVectorEnv(num_envs=20), []

    def look(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        kept.append(observation.copy())
        return PhasePolicy(RUN.mean)(observation)

    record(env, look, steps=15, seed=3, dt=env.dt)
    return np.concatenate(kept)


def test_curves_are_linear_between_knots_and_constant_beyond() -> None:
    values = np.array([[1.0, 3.0, -1.0, 0.0]])
    clock = np.array([0.0, 0.25, 0.375, 0.5, 0.875, 1.0, 1.4])
    knots = np.array(RUN.swing_knots)
    np.testing.assert_allclose(between(knot_shares(clock, knots), values), [1.0, 1.0, 2.0, 3.0, -0.5, 0.0, 0.0])
    repeated = np.repeat(values, 7, axis=0)
    np.testing.assert_array_equal(
        between(knot_shares(clock, knots), repeated), between(knot_shares(clock, knots), values)
    )


def test_each_world_has_its_own_parameters_and_nothing_is_remembered(seen: NDArray[np.float32]) -> None:
    several = RUN.mean + RUN.deviation * np.random.default_rng(0).normal(size=(len(seen), len(RUN.mean)))
    together = PhasePolicy(several)(seen)
    assert together.dtype == np.float32
    assert np.abs(together).max() <= 1.0
    assert np.ptp(together, axis=0).min() > 0.5
    for i in (7, 100, 299):
        np.testing.assert_array_equal(PhasePolicy(several[i])(seen[i : i + 1])[0], together[i])
    np.testing.assert_array_equal(PhasePolicy(several)(seen), together)


def test_the_mirrored_world_gets_the_mirrored_action(seen: NDArray[np.float32]) -> None:
    env, policy = VariableLegVectorEnv(num_envs=1), PhasePolicy(RUN.mean)
    told = seen[seen[:, env.observation_names.index("last_touchdown_side")] != 0]
    assert len(told) > 200
    np.testing.assert_array_equal(policy(env.mirror_observation.image(told)), env.mirror_action.image(policy(told)))


def test_the_clock_of_the_leg_that_is_ahead(seen: NDArray[np.float32]) -> None:
    """What an unloaded leg is asked for comes from its own clock: half a cycle ahead of the one that touched down."""
    names = VariableLegVectorEnv(num_envs=1).observation_names
    row = np.zeros((1, len(names)), np.float32)
    row[0, names.index("last_touchdown_side")] = 1.0
    row[0, names.index("time_since_touchdown")] = 0.25 / 0.445
    only = RUN.mean * 0
    only[10 + 2] = 0.4  # the swing's angle at three quarters of a cycle
    np.testing.assert_allclose(PhasePolicy(only)(row)[0, :2], [0.0, 1.5 * 0.4], atol=1e-6)
    row[0, names.index("last_touchdown_side")] = -1.0
    np.testing.assert_allclose(PhasePolicy(only)(row)[0, :2], [1.5 * 0.4, 0.0], atol=1e-6)
    row[0, names.index("left_load")] = 1.0  # a loaded leg has the torque of the stance, here none
    np.testing.assert_allclose(PhasePolicy(only)(row)[0, :2], [0.0, 0.0], atol=1e-6)


def test_parameters_are_linear_in_what_is_asked(seen: NDArray[np.float32]) -> None:
    """At the ends of two spans, in the middle of one, and beyond: as a controller of those numbers alone."""
    size, random = len(RUN.mean), np.random.default_rng(1)
    blocks = [RUN.mean + RUN.deviation * random.normal(size=size), *(0.3 * random.normal(size=(2, size)))]
    spans = (Span("target_speed", 0.5, 1.5), Span("stiffness_share", 0.7, 1.3))
    policy, rows = PhasePolicy(np.concatenate(blocks), spans=spans), seen[100:120].copy()
    names = VariableLegVectorEnv(num_envs=1).observation_names
    for speed, share, by_speed, by_share in ((0.5, 1.0, -1, 0), (1.5, 0.7, 1, -1), (1.0, 1.3, 0, 1), (2.0, 1.0, 2, 0)):
        rows[:, names.index("target_speed")], rows[:, names.index("stiffness_share")] = speed, share
        alone = PhasePolicy(blocks[0] + by_speed * blocks[1] + by_share * blocks[2])
        np.testing.assert_allclose(policy(rows), alone(rows), atol=1e-5)


def test_parameters_are_polynomials_of_what_is_asked(seen: NDArray[np.float32]) -> None:
    """A square and a cube of the speed's share of half its range, -1 and 1 at its ends."""
    size, random = len(RUN.mean), np.random.default_rng(2)
    blocks = [RUN.mean, *(0.3 * random.normal(size=(3, size)))]
    spans = [Span("target_speed", 0.5, 1.5, power) for power in (1, 2, 3)]
    policy, rows = PhasePolicy(np.concatenate(blocks), spans=spans), seen[100:120].copy()
    for speed, share in ((0.5, -1.0), (0.75, -0.5), (0.75, -0.5), (1.0, 0.0), (1.5, 1.0)):
        rows[:, COLUMNS["target_speed"]] = speed
        alone = PhasePolicy(sum(share**power * block for power, block in enumerate(blocks)))
        np.testing.assert_allclose(policy(rows), alone(rows), atol=1e-5)


@pytest.mark.parametrize("gait", CLOCKS)
def test_each_gait_has_its_clock(gait: str) -> None:
    """The other leg is ahead by what the footfall says: the right one is at 1 - phase where the left one lands."""
    clock, phase = CLOCKS[gait], FOOTFALLS[gait].phase
    assert CLOCKS.keys() == FOOTFALLS.keys()
    assert len(clock.mean) == len(clock.deviation) == sum(len(values) for _, values, _ in clock.parts)
    assert [name for name, _, _ in clock.parts] == [name for name, _, _ in RUN.parts]
    assert (clock.deviation > 0).all()
    names = VariableLegVectorEnv(num_envs=1).observation_names
    row = np.zeros((1, len(names)), np.float32)
    policy = PhasePolicy(clock.mean, gait)
    of = policy.parts_for(row)
    for side, own, other in ((1.0, 0, 1), (-1.0, 1, 0)):
        row[0, names.index("last_touchdown_side")] = side
        row[0, names.index("time_since_touchdown")] = 0.1 / clock.rate
        moved = (1.0 - phase) % 1.0 if side > 0 else phase
        for leg, at in ((own, 0.1), (other, 0.1 + moved)):
            drive = between(knot_shares(np.array([at]), np.array(clock.swing_knots)), of["swing_drive"])
            np.testing.assert_allclose(policy(row)[0, 2 + leg], drive[0], atol=1e-6)
