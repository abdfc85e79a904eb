"""Trials: into the gait and on under a disturbance, each in its own environment."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.humanoid.changed_body import scaled
from romgrl.humanoid.model import build
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.stages.rollouts.disturbed import Outcome, Start, disturb, walk_in

TRIALS, STEPS = 6, 8
DELAYS = np.array([1, 3, 5, 7, 2, 4])
NO_FALL = {"fall_pelvis_height": 0.0, "fall_head_height": 0.0, "fall_trunk_lean": 9.0}


def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depends on what it sees."""
    return np.tanh(observation[:, 1:22])


def stays(**settings: float) -> PlanarHumanoidVectorEnv:
    """Humanoids for which no posture is a fall."""
    return PlanarHumanoidVectorEnv(num_envs=TRIALS, episode_steps=1000, **(NO_FALL | settings))


@pytest.fixture(scope="module")
def start() -> Start:
    return walk_in(stays(), policy, DELAYS, seed=3)


def test_each_trial_settles_for_its_own_time(start: Start) -> None:
    env = stays()
    observation, _ = env.reset(seed=3)
    for step in range(1, 8):
        observation = env.step(policy(observation))[0]
        there = step == DELAYS
        np.testing.assert_array_equal(start.observation[there], observation[there])
        np.testing.assert_array_equal(start.state["states"][there], env.state()["states"][there])
    assert not start.fallen.any()


@pytest.mark.parametrize("nothing", [{}, {"force": 0.0, "push_steps": 3}, {"noise": np.zeros(358, np.float32)}])
def test_nothing_is_the_undisturbed_rollout_bit_for_bit(start: Start, nothing: dict[str, object]) -> None:
    """Trial 3 settles longest: its rollout is that of an environment that just goes on."""
    env = stays()
    observation, _ = env.reset(seed=3)
    velocity = []
    for _ in range(7 + STEPS):
        observation, _, _, _, info = env.step(policy(observation))
        velocity.append(info["forward_velocity"][3])
    outcome = disturb(stays(), policy, start, steps=STEPS, **nothing)
    np.testing.assert_array_equal(outcome.velocity[3], velocity[7:])
    assert outcome.upright.all()


def test_only_a_model_scaled_by_one_changes_nothing(start: Start) -> None:
    plain = disturb(stays(), policy, start, steps=STEPS)
    for mass, same in ((1.0, True), (1.2, False)):
        env = PlanarHumanoidVectorEnv(model=scaled(build(), mass=mass), num_envs=TRIALS, episode_steps=1000, **NO_FALL)
        assert np.array_equal(disturb(env, policy, start, steps=STEPS).velocity, plain.velocity) == same


def test_pushes_and_noise_depend_on_their_size_and_seed(start: Start) -> None:
    env, ones = stays(), np.full(358, 0.1, np.float32)

    def run(**settings: object) -> Outcome:
        return disturb(env, policy, start, steps=STEPS, **settings)

    plain, pushed = run(), run(force=500.0, push_steps=3)
    assert (pushed.velocity[:, 0] > plain.velocity[:, 0]).all()
    assert (run(force=-500.0, push_steps=3).velocity[:, 0] < plain.velocity[:, 0]).all()
    np.testing.assert_array_equal(run(force=500.0, push_steps=3).velocity, pushed.velocity)  # the same env, again
    noisy = run(noise=ones, seed=1).velocity
    np.testing.assert_array_equal(run(noise=ones, seed=1).velocity, noisy)
    for other in (plain.velocity, run(noise=ones, seed=2).velocity, run(noise=2 * ones, seed=1).velocity):
        assert (other != noisy).any()


def test_the_noise_has_its_standard_deviation(start: Start) -> None:
    seen: list[NDArray[np.float32]] = []

    def remember(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen.append(observation)
        return np.zeros((TRIALS, 21), np.float32)

    noise = np.zeros(358, np.float32)
    noise[10:110] = 0.5
    disturb(stays(), remember, start, steps=1, noise=noise)
    difference = seen[0] - start.observation
    assert difference[:, 10:110].std() == pytest.approx(0.5, rel=0.1)
    assert abs(difference[:, 10:110].mean()) < 4 * 0.5 / np.sqrt(600)
    assert not difference[:, :10].any()
    assert not difference[:, 110:].any()


def test_who_cannot_stay_up_falls_in_every_trial() -> None:
    """Limits that no posture keeps: each step is a fall, and nothing after it counts."""
    env = stays(fall_pelvis_height=3.0)
    start = walk_in(env, policy, DELAYS, seed=0)
    assert start.fallen.all()
    outcome = disturb(env, policy, start, steps=STEPS)
    assert outcome.fallen.all()
    assert not outcome.upright.any()


def test_a_fall_after_the_start_of_the_disturbance_is_not_one_before() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=TRIALS, episode_steps=1000)
    start = walk_in(env, policy, np.ones(TRIALS, np.int64), seed=0)
    assert not start.fallen.any()
    outcome = disturb(env, policy, start, steps=60)  # nobody has taught it anything
    assert outcome.fallen.all()
    assert outcome.upright[:, 0].all()
    np.testing.assert_array_equal(outcome.upright, np.logical_and.accumulate(outcome.upright, axis=1))
