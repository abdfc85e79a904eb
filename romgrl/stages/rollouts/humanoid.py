"""A policy in the humanoid's task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import until_first_fall
from romgrl.gait.recording import Policy
from romgrl.humanoid.loads import Loads, replay
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv


def roll_out(
    env: PlanarHumanoidVectorEnv, policy: Policy, *, steps: int, seed: int, progress: Callable[[int], None]
) -> dict[str, NDArray[Any]]:
    """As `roll_out_all`, and states (T', nq + nv) of one episode up to its fall, of the first without a fall where
    there is one."""
    arrays, states = roll_out_all(env, policy, steps=steps, seed=seed, progress=progress)
    upright = arrays["upright"]
    longest = int(upright.sum(axis=1).argmax())  # the first of the longest
    return {**arrays, "states": states[longest, : max(1, int(upright[longest].sum()))]}


def roll_out_all(
    env: PlanarHumanoidVectorEnv, policy: Policy, *, steps: int, seed: int, progress: Callable[[int], None]
) -> tuple[dict[str, NDArray[Any]], NDArray[np.float64]]:
    """One episode of `steps` steps in each of the E environments; a walker is not upright from its first fall on.

    features (E, T, 5) m, velocity (E, T) m/s, upright (E, T), trunk_lean (E, T) rad, contact (E, T, 2), arrays of
    `Loads`; and states (E, T, nq + nv): qpos and qvel before each step.
    """
    size = (env.num_envs, steps)
    features, velocity = np.zeros((*size, 5), np.float32), np.zeros(size, np.float32)
    upright, trunk_lean = np.zeros(size, np.bool_), np.zeros(size, np.float32)
    states, actions = np.zeros((*size, env.states().shape[1])), np.zeros((*size, env.model.nu))
    observation, _ = env.reset(seed=seed)
    for step in range(steps):
        states[:, step] = env.states()
        actions[:, step] = policy(observation)
        observation, _, terminated, _, info = env.step(actions[:, step].astype(np.float32))
        features[:, step], velocity[:, step] = info["features"], info["forward_velocity"]
        upright[:, step], trunk_lean[:, step] = ~terminated, info["trunk_lean"]
        progress(step + 1)
    upright = until_first_fall(upright)
    loads = Loads.empty(*size, substeps=env.substeps)
    for episode, lasted in enumerate(upright.sum(axis=1)):
        steps_taken = slice(0, int(lasted))
        replayed = replay(env.model, states[episode, steps_taken], actions[episode, steps_taken], env.substeps)
        loads.put((episode, steps_taken), replayed)
    arrays = {
        "features": features,
        "velocity": velocity,
        "upright": upright,
        "trunk_lean": trunk_lean,
        "contact": loads.contact,
        **loads.arrays(),
    }
    return arrays, states
