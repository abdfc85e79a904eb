"""A policy on the reduced-order model."""

from __future__ import annotations

import numpy as np

from romgrl.algorithms.ppo import PPOPolicy
from romgrl.gait.features import Gait, until_first_fall
from romgrl.rom.interface import RomVectorEnv


def record(env: RomVectorEnv, policy: PPOPolicy, *, steps: int, seed: int) -> Gait:
    """One episode of `steps` steps in each environment; what follows a fall is marked invalid."""
    features = np.zeros((env.num_envs, steps, 5), np.float32)
    velocity = np.zeros((env.num_envs, steps), np.float32)
    contact = np.zeros((env.num_envs, steps, 2), bool)
    upright = np.ones((env.num_envs, steps), bool)
    observation, _ = env.reset(seed=seed)
    for step in range(steps):
        observation, _, terminated, _, info = env.step(policy(observation))
        features[:, step], velocity[:, step] = info["features"], info["forward_velocity"]
        contact[:, step], upright[:, step] = info["contact"], ~terminated
    valid = until_first_fall(upright)
    return Gait(features, valid, ~valid[:, -1], env.dt, velocity=velocity, contact=contact)
