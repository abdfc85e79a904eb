"""The Gymnasium interface."""

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from romgrl.rom import _core
from romgrl.rom.env import SpringLegEnv
from romgrl.rom.observation import ACTION_NAMES, OBSERVATION_NAMES, PAPER_OBSERVATION_NAMES, mirror
from romgrl.rom.parameters import SpringLegParameters
from romgrl.rom.vector_env import SpringLegVectorEnv


@pytest.mark.filterwarnings("ignore:.*A Box observation space m.* value is")
@pytest.mark.parametrize("observation", ["full", "paper"])
def test_check_env(observation: str) -> None:
    parameters = SpringLegParameters(observation=observation)
    check_env(SpringLegEnv(parameters=parameters, render_mode="rgb_array"), skip_render_check=True)


def test_registered_ids() -> None:
    env = gymnasium.make("romgrl/SpringLeg-v0")
    assert env.observation_space.shape == (20,)
    worlds = gymnasium.make_vec("romgrl/SpringLeg-v0", num_envs=3, vectorization_mode="vector_entry_point", speed=2.0)
    observation, _ = worlds.reset(seed=0)
    assert observation.shape == (3, 20)
    assert worlds.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP


def test_env_agrees_with_the_vector_env_over_episodes() -> None:
    worlds, env = SpringLegVectorEnv(num_envs=1, episode_steps=15), SpringLegEnv(episode_steps=15)
    expected, _ = worlds.reset(seed=11)
    observation, info = env.reset(seed=11)
    np.testing.assert_array_equal(observation, expected[0])
    ends = [0, 0]
    for action in np.random.default_rng(0).uniform(-1, 1, (200, 2)).astype(np.float32):
        expected, reward, terminated, truncated, vector_info = worlds.step(action[None])
        observation, own_reward, own_terminated, own_truncated, info = env.step(action)
        np.testing.assert_array_equal(observation, vector_info["final_obs"][0])
        np.testing.assert_array_equal(info["features"], vector_info["features"][0])
        assert (own_reward, own_terminated, own_truncated) == (reward[0], terminated[0], truncated[0])
        ends[0] += own_terminated
        ends[1] += own_truncated
        if own_terminated or own_truncated:
            observation, info = env.reset()
            np.testing.assert_array_equal(observation, expected[0])
            np.testing.assert_array_equal(info["features"], vector_info["reset_features"][0])
    assert min(ends) > 0


def test_autoreset_returns_both_observations() -> None:
    worlds = SpringLegVectorEnv(num_envs=8, episode_steps=7)
    worlds.reset(seed=0)
    for step in range(1, 15):
        observation, _, terminated, truncated, info = worlds.step(np.zeros((8, 2), np.float32))
        done = terminated | truncated
        assert truncated.all() == (step % 7 == 0)
        assert not (terminated & truncated).any()
        same = (observation == info["final_obs"]).all(axis=1)
        np.testing.assert_array_equal(same, ~done)
        np.testing.assert_array_equal(info["features"][~done], info["reset_features"][~done])
        np.testing.assert_array_equal(observation[done, 16:18], 0.0)  # no previous action


def test_seeds_of_reset() -> None:
    worlds = SpringLegVectorEnv(num_envs=4)
    first = worlds.reset(seed=1)[0].copy()
    second = worlds.reset()[0].copy()
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(worlds.reset(seed=1)[0], first)
    np.testing.assert_array_equal(worlds.reset()[0], second)
    assert not np.array_equal(worlds.reset(seed=2)[0], first)
    with pytest.raises(ValueError, match="one seed"):
        worlds.reset(seed=[1, 2, 3, 4])
    unseeded = SpringLegVectorEnv(num_envs=4).reset()[0]
    assert not np.array_equal(unseeded, SpringLegVectorEnv(num_envs=4).reset()[0])


@pytest.mark.parametrize(("reward", "alpha"), [("exponential", 1.0), ("exponential", 2.5), ("forward_velocity", 1.0)])
def test_reward(reward: str, alpha: float) -> None:
    """exp(-alpha |v - v*|) or v, with v the mean velocity of the trunk over the control step."""
    worlds = SpringLegVectorEnv(num_envs=4, speed=3.0, reward=reward, alpha=alpha)
    worlds.reset(seed=0)
    for _ in range(5):
        before = worlds.save()
        _, found, terminated, _, info = worlds.step(np.zeros((4, 2), np.float32))
        after = worlds.save()
        velocity = (after[:, 0] + after[:, 19] - before[:, 0] - before[:, 19]) * 30.0
        kept = ~terminated
        np.testing.assert_allclose(info["forward_velocity"][kept], velocity[kept], atol=1e-5)
        expected = velocity if reward == "forward_velocity" else np.exp(-alpha * np.abs(velocity - 3.0))
        np.testing.assert_allclose(found[kept], expected[kept], atol=1e-5)


def test_observation_in_numbers() -> None:
    """Every column of a pose worked out by hand."""
    pose = _core.Pose()
    pose.x, pose.y, pose.vx, pose.vy = 7.0, 0.95, 3.0, -0.5
    pose.hip_angle, pose.hip_rate = (0.3, -0.2), (1.0, -2.0)
    pose.leg_length, pose.leg_rate = (0.80, 0.87), (0.4, -0.1)
    worlds = SpringLegVectorEnv(num_envs=1, speed=3.5)
    observation, info = worlds.place(0, pose)
    length, speed, rate = 0.865, math.sqrt(9.81 * 0.865), math.sqrt(9.81 / 0.865)
    strain = 0.80 / length - 1.0
    expected = [
        0.0,
        0.95 / length,
        3.0 / speed,
        -0.5 / speed,
        0.0,
        0.0,
        strain,
        0.87 / length - 1.0,
        0.4 / speed,
        -0.1 / speed,
    ]
    expected += [0.3, -0.2, 1.0 / rate, -2.0 / rate, 0.0, 0.0, 0.0, 0.0, 3.5 / speed, 0.0]
    np.testing.assert_allclose(observation[0], expected, atol=2e-6)
    feet = [0.8 * math.sin(0.3), -0.8 * math.cos(0.3), 0.87 * math.sin(-0.2), -0.87 * math.cos(0.2)]
    np.testing.assert_allclose(info["features"][0], [0.95, *feet], atol=1e-6)
    pose.y = 0.8 * math.cos(0.3) + 0.07  # the left foot is in the ground, its leg compressed
    observation, info = worlds.place(0, pose)
    load = (24000.0 * 0.065 - 30.0 * 0.4) / (71.8 * 9.81)
    np.testing.assert_allclose(observation[0, 14:16], [load, 0.0], atol=1e-5)
    assert info["contact"].tolist() == [[True, True]]


def test_paper_observation_is_a_part_of_the_full_one() -> None:
    full, paper = (
        SpringLegVectorEnv(num_envs=3),
        SpringLegVectorEnv(parameters=SpringLegParameters(observation="paper"), num_envs=3),
    )
    assert paper.reset(seed=0)[0].shape == (3, 13)
    columns = [0, 1, 2, 3, 6, 7, 8, 9, 10, 11, 12, 13, 18]
    np.testing.assert_array_equal(paper.reset(seed=0)[0], full.reset(seed=0)[0][:, columns])


def test_mirror_permutations() -> None:
    for permutation, sign in map(mirror, (OBSERVATION_NAMES, PAPER_OBSERVATION_NAMES, ACTION_NAMES)):
        np.testing.assert_array_equal(permutation[permutation], np.arange(len(permutation)))
        np.testing.assert_array_equal(sign * sign[permutation], 1.0)
    np.testing.assert_array_equal(mirror(ACTION_NAMES).permutation, [1, 0])
    names = [OBSERVATION_NAMES[column] for column in mirror(OBSERVATION_NAMES).permutation]
    assert names[6:8] == ["right_leg_strain", "left_leg_strain"]
    assert mirror(OBSERVATION_NAMES).sign.tolist() == [1.0] * 19 + [-1.0]


def test_large_actions_are_clipped() -> None:
    one, many = SpringLegVectorEnv(num_envs=2), SpringLegVectorEnv(num_envs=2)
    one.reset(seed=0)
    many.reset(seed=0)
    sign = np.array([[1, -1], [-1, -1]], np.float32)
    np.testing.assert_array_equal(one.step(sign)[0], many.step(50 * sign)[0])


def test_rendering_shows_the_trunk_and_both_feet() -> None:
    env = SpringLegEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    image = env.render()
    assert image is not None
    assert image.shape == (360, 640, 3)
    assert image.dtype == np.uint8
    for colour in ((55, 65, 81), (37, 99, 235), (217, 83, 25)):
        assert (np.abs(image.astype(int) - colour).max(axis=2) < 8).sum() > 100
    assert SpringLegEnv().render() is None
