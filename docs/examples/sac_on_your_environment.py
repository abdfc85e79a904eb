"""Our SAC on an environment of your own, here Gymnasium's Pendulum: actions in [-1, 1], rows that reset themselves."""

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode

from romgrl.algorithms.replay_buffer import ReplayBuffer
from romgrl.algorithms.sac import SAC

ENVS, BATCH, START = 4, 128, 250


def main(steps: int = 1500) -> np.ndarray:
    """Train for so many steps of four pendulums; returns the mean reward of each step (-16.3 at worst, 0 upright)."""
    torch.set_num_threads(1)  # of networks as small as these, threads wait for one another
    env = gym.make_vec("Pendulum-v1", num_envs=ENVS, vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP})
    sac = SAC(
        observation_size=3, action_size=1, hidden_sizes=[64, 64], layer_norm=False, policy_learning_rate=1e-3,
        critic_learning_rate=1e-3, temperature_learning_rate=1e-3, initial_temperature=0.2, target_entropy_scale=1.0,
        gamma=0.98, tau=0.01, policy_delay=1, critic_target="minimum", policy_average=0.0, seed=0,
    )  # fmt: skip
    buffer = ReplayBuffer(capacity=20_000, num_envs=ENVS, observation_size=3, action_size=1, window_size=1, seed=0)
    no_window, rewards = torch.zeros(ENVS, 1), np.zeros(steps)  # windows are for a discriminator
    observation = torch.from_numpy(env.reset(seed=0)[0])
    for step in range(steps):
        action = sac.act(observation)
        following, reward, terminated, truncated, _ = env.step(2.0 * action.numpy())
        following, *ended = (torch.from_numpy(x).float() for x in (following, reward, terminated, truncated))
        buffer.add(observation, action, following, *ended, no_window)
        observation, rewards[step] = following, reward.mean()
        for batch in buffer.sample(ENVS * BATCH).split(ENVS) if step >= START else ():
            sac.update(batch, batch.task_reward[:, 0])
    env.close()
    return rewards


if __name__ == "__main__":
    for start, part in enumerate(np.split(main(), 5)):
        print(f"steps {300 * start} to {300 * (start + 1)}: reward {part.mean():.2f}")
