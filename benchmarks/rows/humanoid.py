"""The humanoid environment beside its physics alone, and beside one environment in Python."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from benchmarks.measure import Options, Result, compare, rate
from romgrl.humanoid.env import PlanarHumanoidEnv
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

HUMANOIDS, STEPS = 32, 60
ACTIONS = "uniform random, new at every step"


def actions(steps: int, humanoids: int = HUMANOIDS) -> NDArray[np.float32]:
    """(steps, humanoids, 21) in [-1, 1]."""
    return np.random.default_rng(0).uniform(-1, 1, (steps, humanoids, 21)).astype(np.float32)


def whole_env(env: PlanarHumanoidVectorEnv, chosen: NDArray[np.float32]) -> Callable[[], float]:
    """Steps per second of physics, observation, reward and resets, from the same start every time."""
    steps = rate(lambda: [env.step(action) for action in chosen], chosen.shape[0] * chosen.shape[1])

    def measure() -> float:
        env.reset(seed=0)
        return steps()

    return measure


def visited_states(env: PlanarHumanoidVectorEnv, chosen: NDArray[np.float32]) -> NDArray[np.float64]:
    """State before every step of `whole_env`, (steps, humanoids, 48)."""
    env.reset(seed=0)
    states = []
    for action in chosen:
        states.append(env.states())
        env.step(action)
    return np.array(states)


def bare_steps(env: PlanarHumanoidVectorEnv, chosen: NDArray[np.float32], threads: int) -> Callable[[], float]:
    """Steps per second of mj_step alone, looped over in C++, from the states that the environment visits."""
    batch, states = Batch(env.model, env.num_envs, threads), visited_states(env, chosen)
    qpos, qvel, controls = (batch.bind(name) for name in ("qpos", "qvel", "ctrl"))

    def measure() -> float:
        spent = 0.0
        for state, action in zip(states, chosen, strict=True):
            qpos[:], qvel[:], controls[:] = state[:, : env.model.nq], state[:, env.model.nq :], action
            start = time.perf_counter()
            batch.step(nstep=env.substeps)
            spent += time.perf_counter() - start
        return float(chosen.shape[0] * chosen.shape[1] / spent)

    return measure


def beside_physics(options: Options) -> Result:
    """What observation, reward and resets cost on top of the physics."""
    chosen, threads = actions(options.scaled(STEPS)), options.threads
    env = PlanarHumanoidVectorEnv(num_envs=HUMANOIDS, num_threads=threads)
    return compare(
        whole_env(env, chosen),
        bare_steps(env, chosen, threads),
        unit="control steps/s",
        target=">= 0.9",
        settings={"humanoids": HUMANOIDS, "threads": threads, "substeps": env.substeps, "actions": ACTIONS},
        repeats=options.repeats,
    )


def one_by_one(env: PlanarHumanoidEnv, chosen: NDArray[np.float32]) -> Callable[[], float]:
    """Steps per second of one environment in Python, reset when its episode ends."""

    def run() -> None:
        for action in chosen:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    def measure() -> float:
        env.reset(seed=0)
        return steps()

    steps = rate(run, len(chosen))
    return measure


def beside_one_env(options: Options) -> Result:
    """Vector environment on one core beside a plain Gymnasium environment with the same model."""
    chosen = actions(options.scaled(STEPS))
    env = PlanarHumanoidVectorEnv(num_envs=HUMANOIDS, num_threads=1)
    single = PlanarHumanoidEnv(model=env.model)
    return compare(
        whole_env(env, chosen),
        one_by_one(single, chosen.reshape(-1, chosen.shape[-1])[: 10 * len(chosen)]),
        unit="control steps/s/core",
        target=">= 2",
        settings={
            "humanoids": HUMANOIDS,
            "threads": 1,
            "actions": ACTIONS,
            "reference": "one PlanarHumanoidEnv: mj_step, observation and reward in Python",
        },
        repeats=options.repeats,
    )
