"""The reduced-order model: through Python beside a bare loop, threads, and the physics of each engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Options, Result, Unavailable, compare, rate
from benchmarks.setup import configuration
from romgrl.config.worlds import SpringLeg
from romgrl.rom.parameters import SpringLegParameters, VariableLegParameters
from romgrl.rom.vector_env import SpringLegVectorEnv, VariableLegVectorEnv

WORLDS, STEPS = 64, 600
MANY_WORLDS = 2048  # a step of 64 of the native engine's takes 25 us, too little to share
BEFORE = 20_000.0  # control steps/s/core before any of this was measured: the middle of 17-23 k
FULL_SPEED = 1e6  # control steps/s/core that an engine of our own aims at


def make(threads: int, worlds: int = WORLDS, **parameters: Any) -> SpringLegVectorEnv:
    """Worlds of the default model, at their start."""
    env = SpringLegVectorEnv(parameters=SpringLegParameters(**parameters), num_envs=worlds, num_threads=threads)
    env.reset(seed=0)
    return env


def held_actions(env: SpringLegVectorEnv) -> NDArray[np.float32]:
    """One random action per world; under it worlds run, fall and start anew."""
    return np.random.default_rng(0).uniform(-1, 1, env.action_space.shape or ()).astype(np.float32)


def through_python(env: SpringLegVectorEnv, steps: int) -> Callable[[], object]:
    """`steps` control steps of all worlds."""
    action = held_actions(env)
    return lambda: [env.step(action) for _ in range(steps)]


def bare_loop(env: SpringLegVectorEnv, steps: int) -> Callable[[], object]:
    """The same steps in C++ alone."""
    action = held_actions(env)
    return lambda: env._batch.repeat(action, env._buffers, steps)


def settings(env: SpringLegVectorEnv, threads: int) -> dict[str, Any]:
    """What the rows have in common."""
    p = env.parameters
    solver = {"substeps": p.substeps, "iterations": [p.velocity_iterations, p.position_iterations]}
    return {
        "worlds": env.num_envs,
        "threads": threads,
        "engine": p.engine,
        **solver,
        "actions": "one random action held",
    }


def python_overhead(options: Options, threads: int) -> Result:
    """Steps per second through Python beside the same number of the same steps in C++."""
    steps, engine = options.scaled(STEPS), default_engine(threads)
    ours, bare = make(threads, **engine), make(threads, **engine)
    return compare(
        rate(through_python(ours, steps), steps * WORLDS),
        rate(bare_loop(bare, steps), steps * WORLDS),
        unit="control steps/s",
        target=">= 0.95",
        settings={**settings(ours, threads), "reference": "Batch.repeat, the loop in C++"},
        repeats=options.repeats,
    )


def overhead_one_thread(options: Options) -> Result:
    """On one thread."""
    return python_overhead(options, 1)


def overhead_two_threads(options: Options) -> Result:
    """On two threads."""
    return python_overhead(options, 2)


def two_threads(options: Options) -> Result:
    """Two threads beside one."""
    if options.threads < 2:
        raise Unavailable("two threads are compared with one, and --threads allows one")
    steps = options.scaled(STEPS)
    engine = default_engine(2)
    one, two = make(1, MANY_WORLDS, **engine), make(2, MANY_WORLDS, **engine)
    return compare(
        rate(through_python(two, steps), steps * MANY_WORLDS),
        rate(through_python(one, steps), steps * MANY_WORLDS),
        unit="control steps/s",
        target=">= 1.85",
        settings={**settings(two, 2), "reference": "one thread"},
        repeats=options.repeats,
    )


def physics(options: Options, env: SpringLegVectorEnv, reference: float, target: str) -> Result:
    """Steps per second of one core, without Python between them, beside a fixed number."""
    steps = options.scaled(round(STEPS * reference / BEFORE))
    return compare(
        rate(bare_loop(env, steps), steps * WORLDS),
        lambda: reference,
        unit="control steps/s/core",
        target=target,
        settings={**settings(env, 1), "reference": f"{reference:,.0f}"},
        repeats=options.repeats,
    )


def box2d(options: Options) -> Result:
    """Box2D beside what it did before any of this."""
    return physics(options, make(1, engine="box2d"), BEFORE, ">= 3")


def native(options: Options) -> Result:
    """The engine of our own beside its aim."""
    return physics(options, make(1, engine="native"), FULL_SPEED, ">= 1")


def native_motors(options: Options) -> Result:
    """The same of legs with motors."""
    env = VariableLegVectorEnv(parameters=VariableLegParameters(engine="native"), num_envs=WORLDS, num_threads=1)
    env.reset(seed=0)
    return physics(options, env, FULL_SPEED, ">= 2")


def default_engine(threads: int) -> dict[str, Any]:
    """Engine of the default configuration."""
    rom = configuration(threads=threads).rom
    assert isinstance(rom, SpringLeg)
    return {"engine": rom.engine}
