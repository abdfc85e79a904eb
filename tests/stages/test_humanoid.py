"""The humanoid that a configuration asks for."""

import numpy as np
import pytest

from romgrl.stages.wiring.humanoid import humanoid_env, speed_sensitivity
from tests.conftest import Composer


@pytest.mark.parametrize(
    ("alpha", "speed", "expected"), [("null", 4.0, 1.0), ("null", 1.0, 4.0), ("null", 0.0, 8.0), ("2.5", 1.0, 2.5)]
)
def test_a_relative_error_of_the_speed_counts_the_same_at_all_speeds(
    alpha: str, speed: float, expected: float, compose_config: Composer
) -> None:
    config = compose_config(f"student.alpha={alpha}", f"speed={speed}", "threads=1")
    assert speed_sensitivity(config) == expected
    env = humanoid_env(config, num_envs=2)
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.zeros((2, env.model.nu), np.float32))
    assert reward == pytest.approx(np.exp(-expected * np.abs(info["forward_velocity"] - speed)))
    env.close()
