"""The plain environment: Gymnasium's checks, and the same numbers as the vector environment."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from romgrl.humanoid.env import PlanarHumanoidEnv
from romgrl.humanoid.model import build
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv


def test_gymnasium_accepts_it() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # unbounded observations
        check_env(gym.make("romgrl/PlanarHumanoid-v0", episode_steps=20).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("actuation", ["servo", "torque"])
def test_same_bits_as_the_vector_environment(actuation: str) -> None:
    arguments = {"model": build(actuation=actuation), "speed": 3.0, "alpha": 0.5, "episode_steps": 12}
    single, vector = PlanarHumanoidEnv(**arguments), PlanarHumanoidVectorEnv(num_envs=1, **arguments)
    alone, _ = single.reset(seed=3)
    together, _ = vector.reset(seed=3)
    assert np.array_equal(alone, together[0])
    generator, ended = np.random.default_rng(0), [0, 0]
    for _ in range(120):
        action = generator.uniform(-1.2, 1.2, 21).astype(np.float32)
        alone, reward, terminated, truncated, info = single.step(action)
        together, rewards, terminations, truncations, infos = vector.step(action[None])
        assert np.array_equal(alone, infos["final_obs"][0])
        assert (reward, terminated, truncated) == (rewards[0], terminations[0], truncations[0])
        for name in ("features", "forward_velocity", "trunk_lean", "sole_height", "diverged"):
            assert np.array_equal(info[name], infos[name][0]), name
        ended[0] += terminated
        ended[1] += truncated
        if terminated or truncated:
            alone, _ = single.reset()
            assert np.array_equal(alone, together[0])
    assert ended[0] > 0
    assert ended[1] > 0


def test_divergence_ends_the_episode() -> None:
    env = PlanarHumanoidEnv()
    env.reset(seed=0)
    env._data.qvel[4] = np.nan
    observation, reward, terminated, truncated, info = env.step(np.zeros(21, dtype=np.float32))
    assert (reward, terminated, truncated, info["diverged"]) == (0.0, True, False, True)
    assert np.isfinite(observation).all()


def test_bad_actions() -> None:
    env = PlanarHumanoidEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="shape"):
        env.step(np.zeros(20, dtype=np.float32))
    with pytest.raises(ValueError, match="finite"):
        env.step(np.full(21, np.inf, dtype=np.float32))
