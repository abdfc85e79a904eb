"""Legs with motors as a Gymnasium environment, whose worlds draw their speed and stiffness."""

import gymnasium as gym
import numpy as np

import romgrl  # noqa: F401  registers the environments
from romgrl.rom.parameters import Commands, VariableLegParameters

KEY = "romgrl/VariableLeg-v0"
ASKED = Commands(speed=(1.5, 5.0), stiffness_share=(0.7, 1.4))  # drawn for each episode


def main(steps: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (worlds,) that are asked for, m/s, and positive power (steps, worlds) where legs push, W."""
    parameters = VariableLegParameters(stiffness=10_500.0)
    env = gym.make_vec(KEY, num_envs=8, vectorization_mode="vector_entry_point", parameters=parameters, speed=ASKED)
    observation, _ = env.reset(seed=0)
    froude = env.unwrapped.observation_names.index("target_speed")
    asked = observation[:, froude] * np.sqrt(9.81 * parameters.leg_length)  # observed without a unit
    push = np.tile(np.array([0.0, 0.0, 1.0, 1.0], np.float32), (8, 1))  # left and right hip, left and right motor
    power = np.array([env.step(push)[4]["positive_power"].copy() for _ in range(steps)])
    env.close()
    return asked, power


if __name__ == "__main__":
    speeds, watts = main()
    print("asked for [m/s]:", speeds.round(2))
    print(f"positive power {watts.mean():.0f} W")
