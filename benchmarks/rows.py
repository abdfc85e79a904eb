"""One function per row: (threads) -> value, unit and the settings that it was measured with."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import torch

from romgrl.algorithms.sac import SAC
from romgrl.buffers import ReplayBuffer
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.rom.vector_env import SpringLegVectorEnv

REPEATS = 5


def rate(work: Callable[[], object], count: int) -> float:
    """Median of `count` / seconds over the repeats, after one warm-up."""
    work()
    rates = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        rates.append(count / (time.perf_counter() - start))
    return statistics.median(rates)


def rom_steps(threads: int) -> dict[str, Any]:
    """Control steps per second of the reduced-order model through Python, 64 worlds."""
    env = SpringLegVectorEnv(num_envs=64, num_threads=threads)
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-1, 1, (64, 2)).astype(np.float32)
    value = rate(lambda: [env.step(action) for _ in range(100)], 6400)
    return {"value": round(value), "unit": "control steps/s", "worlds": 64}


def humanoid_steps(threads: int) -> dict[str, Any]:
    """Control steps per second of the humanoid: physics, observation, reward and resets, 32 copies."""
    env = PlanarHumanoidVectorEnv(num_envs=32, num_threads=threads)
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-1, 1, (32, 21)).astype(np.float32)
    value = rate(lambda: [env.step(action) for _ in range(50)], 1600)
    return {"value": round(value), "unit": "control steps/s", "humanoids": 32}


def bare_humanoid_steps(threads: int) -> dict[str, Any]:
    """The same model in a bare loop of mj_step on one thread, no observation: what the physics alone costs."""
    env = PlanarHumanoidVectorEnv(num_envs=1)
    env.reset(seed=0)
    data = mujoco.MjData(env.model)
    data.qpos[:] = env.states()[0, : env.model.nq]
    data.ctrl[:] = np.random.default_rng(0).uniform(-1, 1, env.model.nu)
    value = rate(lambda: mujoco.mj_step(env.model, data, nstep=env.substeps * 1000), 1000)
    return {"value": round(value), "unit": "control steps/s", "threads_used": min(threads, 1)}


def sac_updates(threads: int) -> dict[str, Any]:
    """Updates per second of the tuned student: batch 256, 2 x 256, 167 columns, policy every second update."""
    torch.set_num_threads(threads)
    sac = SAC(
        observation_size=167,
        action_size=21,
        hidden_sizes=[256, 256],
        layer_norm=True,
        policy_learning_rate=3e-4,
        critic_learning_rate=3e-4,
        temperature_learning_rate=3e-4,
        initial_temperature=0.01,
        target_entropy_scale=0.5,
        gamma=0.98,
        tau=0.005,
        policy_delay=2,
        critic_target="mean",
        policy_average=0.99,
        seed=0,
    )
    buffer = ReplayBuffer(capacity=40_000, num_envs=32, observation_size=167, action_size=21, frame_size=6, seed=0)
    for _ in range(1000):
        row = torch.randn(32, 167)
        nothing = torch.zeros(32)
        buffer.add(row, torch.rand(32, 21), row, nothing, nothing, nothing.bool(), torch.zeros(32, 6))

    def work() -> None:
        for batch in buffer.sample(30 * 256).split(30):
            sac.update(batch, batch.task_reward)

    return {"value": round(rate(work, 30), 1), "unit": "updates/s", "batch": 256}


ROWS: dict[str, Callable[[int], dict[str, Any]]] = {
    "rom_steps": rom_steps,
    "humanoid_steps": humanoid_steps,
    "bare_humanoid_steps": bare_humanoid_steps,
    "sac_updates": sac_updates,
}
