"""Ten thousand control steps with random actions, render modes, and machines that cannot draw."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import gymnasium as gym
import numpy as np
import pytest

from romgrl.humanoid.model import build
from romgrl.humanoid.rendering import RenderingError, backend, filmstrip
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv


@pytest.mark.parametrize("actuation", ["servo", "torque"])
def test_ten_thousand_random_steps_stay_finite(actuation: str) -> None:
    env = PlanarHumanoidVectorEnv(model=build(actuation=actuation), num_envs=100)
    env.reset(seed=0)
    generator, falls, fastest = np.random.default_rng(0), 0, 0.0
    for _ in range(100):
        observation, reward, terminated, _, info = env.step(generator.uniform(-1, 1, (100, 21)).astype(np.float32))
        assert np.isfinite(observation).all()
        assert np.isfinite(info["final_obs"]).all()
        assert 0 <= reward.min() <= reward.max() <= 1
        falls += int(terminated.sum())
        fastest = max(fastest, float(np.abs(env.states()[:, 24:]).max()))
    assert env.diverged_count == 0
    assert falls > 100
    assert 10 < fastest < 120


@pytest.fixture
def _forget_backend() -> Iterator[None]:
    backend.cache_clear()
    yield
    backend.cache_clear()


@pytest.mark.usefixtures("_forget_backend")
def test_no_opengl_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(RenderingError, match="MUJOCO_GL") as error:
        filmstrip(build(), np.zeros((2, 48)))
    assert "\n" not in str(error.value)


def test_gymnasium_knows_the_render_mode() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make("romgrl/PlanarHumanoid-v0", render_mode="rgb_array", control_frequency=60.0)
    assert env.metadata["render_modes"] == ["rgb_array"]
    assert env.unwrapped.metadata["render_fps"] == 60
