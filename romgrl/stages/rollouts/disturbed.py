"""Trials of a walker: from a reset into its steady gait, then on under a disturbance; one environment each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]
Tick = Callable[[], None]


@dataclass(frozen=True)
class Start:
    """Where the disturbances of N trials begin."""

    state: dict[str, Any]
    """Of the environment, see its `restore`."""
    observation: NDArray[np.float32]
    """(N, O), with the O columns of the environment."""
    fallen: NDArray[np.bool_]
    """(N,): fell before."""


@dataclass(frozen=True)
class Outcome:
    """What N trials of T control steps came to; nothing after a fall counts."""

    velocity: NDArray[np.float64]
    """(N, T) m/s."""
    upright: NDArray[np.bool_]
    """(N, T): not fallen up to this step."""

    @property
    def fallen(self) -> NDArray[np.bool_]:
        """(N,)."""
        return ~self.upright[:, -1]


def walk_in(
    env: PlanarHumanoidVectorEnv, policy: Policy, steps: NDArray[np.int64], *, seed: int, tick: Tick = lambda: None
) -> Start:
    """Walk undisturbed from resets; trial i ends up in its state after steps[i] (N,) control steps, at least one."""
    observation, _ = env.reset(seed=seed)
    fallen = np.zeros(env.num_envs, np.bool_)
    start, states = observation.copy(), env.state()["states"].copy()
    for step in range(1, int(steps.max()) + 1):
        observation, _, terminated, _, _ = env.step(policy(observation))
        fallen |= terminated & (step <= steps)
        there = step == steps
        start[there], states[there] = observation[there], env.state()["states"][there]
        tick()
    after = env.state()
    clean = {name: np.zeros_like(after[name]) for name in ("warnings", "elapsed")}  # a warning restarts its row at once
    return Start(after | clean | {"states": states}, start, fallen)


def disturb(
    env: PlanarHumanoidVectorEnv,
    policy: Policy,
    start: Start,
    *,
    steps: int,
    force: float = 0.0,
    push_steps: int = 0,
    noise: NDArray[np.float32] | None = None,
    seed: int = 0,
    tick: Tick = lambda: None,
) -> Outcome:
    """Go on from `start` for T = `steps` control steps.

    A forward force (N) acts on the skeleton's pushed body, SMPL's chest, over the first `push_steps`. The policy sees
    every entry of its observation with Gaussian noise of standard deviation `noise` (O,), drawn from `seed`.
    """
    env.restore(start.state)
    env.push(np.full(env.num_envs, force))
    generator = np.random.default_rng(seed)
    observation, fallen = start.observation, start.fallen.copy()
    velocity, upright = np.zeros((env.num_envs, steps)), np.zeros((env.num_envs, steps), np.bool_)
    for step in range(steps):
        if step == push_steps:
            env.push(np.zeros(env.num_envs))
        seen = observation
        if noise is not None:
            seen = observation + noise * generator.standard_normal(observation.shape, dtype=np.float32)
        observation, _, terminated, _, info = env.step(policy(seen))
        fallen |= terminated
        velocity[:, step], upright[:, step] = info["forward_velocity"], ~fallen
        tick()
    return Outcome(velocity, upright)
