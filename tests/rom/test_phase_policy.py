"""The controller with a clock: its curves, its symmetry, and that it remembers nothing."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.recording import record
from romgrl.rom.phase_policy import DEVIATION, MEAN, START, SWING_KNOTS, PhasePolicy, between
from romgrl.rom.vector_env import VariableLegVectorEnv


@pytest.fixture(scope="module")
def seen() -> NDArray[np.float32]:
    """Observations (300, 28) on the way of the first controller, from touchdowns and flights of both legs."""
    env, kept = VariableLegVectorEnv(num_envs=20), []

    def look(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        kept.append(observation.copy())
        return PhasePolicy(MEAN)(observation)

    record(env, look, steps=15, seed=3, dt=env.dt)
    return np.concatenate(kept)


def test_curves_are_linear_between_knots_and_constant_beyond() -> None:
    values = np.array([[1.0, 3.0, -1.0, 0.0]])
    clock = np.array([0.0, 0.25, 0.375, 0.5, 0.875, 1.0, 1.4])
    np.testing.assert_allclose(between(clock, SWING_KNOTS, values), [1.0, 1.0, 2.0, 3.0, -0.5, 0.0, 0.0])
    np.testing.assert_allclose(
        between(clock, SWING_KNOTS, np.repeat(values, 7, axis=0)), between(clock, SWING_KNOTS, values)
    )
    assert sum(len(start) for _, start, _ in START) == len(MEAN) == len(DEVIATION) == 20


def test_each_world_has_its_own_parameters_and_nothing_is_remembered(seen: NDArray[np.float32]) -> None:
    several = MEAN + DEVIATION * np.random.default_rng(0).normal(size=(len(seen), len(MEAN)))
    together = PhasePolicy(several)(seen)
    assert together.dtype == np.float32
    assert np.abs(together).max() <= 1.0
    assert np.ptp(together, axis=0).min() > 0.5
    for i in (7, 100, 299):
        np.testing.assert_array_equal(PhasePolicy(several[i])(seen[i : i + 1])[0], together[i])
    np.testing.assert_array_equal(PhasePolicy(several)(seen), together)


def test_the_mirrored_world_gets_the_mirrored_action(seen: NDArray[np.float32]) -> None:
    env, policy = VariableLegVectorEnv(num_envs=1), PhasePolicy(MEAN)
    told = seen[seen[:, env.observation_names.index("last_touchdown_side")] != 0]
    assert len(told) > 200
    np.testing.assert_array_equal(policy(env.mirror_observation.image(told)), env.mirror_action.image(policy(told)))


def test_the_clock_of_the_leg_that_is_ahead(seen: NDArray[np.float32]) -> None:
    """What an unloaded leg is asked for comes from its own clock: half a cycle ahead of the one that touched down."""
    names = VariableLegVectorEnv(num_envs=1).observation_names
    row = np.zeros((1, len(names)), np.float32)
    row[0, names.index("last_touchdown_side")] = 1.0
    row[0, names.index("time_since_touchdown")] = 0.25 / 0.445
    only = MEAN * 0
    only[9 + 2] = 0.4  # the swing's angle at three quarters of a cycle
    np.testing.assert_allclose(PhasePolicy(only)(row)[0, :2], [0.0, 1.5 * 0.4], atol=1e-6)
    row[0, names.index("last_touchdown_side")] = -1.0
    np.testing.assert_allclose(PhasePolicy(only)(row)[0, :2], [1.5 * 0.4, 0.0], atol=1e-6)
    row[0, names.index("left_load")] = 1.0  # a loaded leg has the torque of the stance, here none
    np.testing.assert_allclose(PhasePolicy(only)(row)[0, :2], [0.0, 0.0], atol=1e-6)
