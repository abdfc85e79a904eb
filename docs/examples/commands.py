"""Humanoids that are asked for a speed, a gait and a style: drawn for a training, from a table, or steered by you."""

import gymnasium as gym
import numpy as np

import romgrl  # noqa: F401  registers the environments
from romgrl.humanoid.command_schedules import CommandTable, DrawnCommands
from romgrl.humanoid.task import relative_sensitivity, speed_reward

TRAINING = DrawnCommands(("walk", "run"), speeds={"walk": (0.5, 2.0), "run": (2.0, 5.0)}, styles=(0.7, 1.4))
RAMP = CommandTable(("walk", "run"), times=[0, 2, 4], speeds=[1, 3, 1], weights=[[1, 0], [0, 1], [1, 0]], ramp=True)
KEY = "romgrl/PlanarHumanoid-v0"


def drawn(steps: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Rewards (steps, 8) of the commands that acted, and those of the same steps, had 3 m/s been asked for."""
    env = gym.make_vec(
        KEY, num_envs=8, vectorization_mode="vector_entry_point", commands=TRAINING, alpha=None, compact=True
    )
    env.reset(seed=0)
    earned, relabelled = np.zeros((steps, 8)), np.zeros((steps, 8))
    for step in range(steps):
        _, earned[step], _, _, info = env.step(np.zeros(env.action_space.shape, np.float32))
        velocity = info["forward_velocity"]  # info["command"] acted, info["reset_command"] is what is observed now
        relabelled[step] = speed_reward(velocity, speed=3.0, alpha=relative_sensitivity(3.0))
    env.close()
    return earned, relabelled


def played(steps: int = 120) -> np.ndarray:
    """Speeds (steps,) that the ramp asks of a body that cannot fall, m/s."""
    upright = {"fall_pelvis_height": 0.0, "fall_head_height": 0.0, "fall_trunk_lean": 9.0}
    env = gym.make(KEY, commands=RAMP, **upright)
    env.reset(seed=0)
    asked = [env.step(np.zeros(21, np.float32))[4]["command"][0] for _ in range(steps)]
    env.close()
    return np.array(asked)


def steered() -> list[list[float]]:
    """Commands in the observation after a reset, and after something else was asked for."""
    env = gym.make(KEY, commands=TRAINING)
    first, _ = env.reset(seed=0, options={"speed": 1.0, "gait": {"walk": 1.0}, "style": 1.0})
    second = env.unwrapped.command(speed=2.0, gait={"walk": 0.5, "run": 0.5})  # from the next step on
    env.close()
    return [first[-4:].tolist(), second[-4:].tolist()]


if __name__ == "__main__":
    rewards, others = drawn()
    print(f"reward {rewards.mean():.2f}, at 3 m/s {others.mean():.2f}")
    print("asked each second:", played()[::30].round(2))
    print("steered:", *steered())
