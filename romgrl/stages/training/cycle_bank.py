"""States of the cycles that a teacher by CMA-ES has found, for the episodes of another one to begin in."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from romgrl.algorithms.divergence import check_physics
from romgrl.artifacts.checkpoint import State
from romgrl.config.schema import Config
from romgrl.config.teachers import ppo_keys
from romgrl.config.values import refusal
from romgrl.errors import ConfigurationError
from romgrl.provenance.cycles import cycle_manifest, shared_ranges
from romgrl.rom.vector_env import SpringLegVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.seeds import CYCLE_SEED
from romgrl.stages.wiring.teacher_policy import load_phase_policy

WORLDS = 128
SETTLED = 450
"""Control steps after a reset that are left out, as those of a reference are."""
KEPT, APART = 16, 7
"""So many states of each world, so many control steps apart: no divisor of a stride, so that all of it is there."""


@dataclass
class CycleBank:
    """States (M, S) of saved worlds, each with the command that it belongs to, and the share of episodes they begin."""

    env: SpringLegVectorEnv
    states: NDArray[np.float64]
    share: float

    def __post_init__(self) -> None:
        self.env.begin_in(self.states, self.share)

    def state(self) -> State:
        """The states: a training that goes on elsewhere draws from those that it began with."""
        return {"states": self.states}

    def restore(self, state: State) -> None:
        """Draw from these states. Raises ValueError where they are none."""
        self.states = np.asarray(state["states"])
        self.env.begin_in(self.states, self.share)


def fill_bank(config: Config, env: SpringLegVectorEnv, log: StageLog) -> CycleBank:
    """Let a share of the episodes of `env` begin in states of `teacher.cycles`, asked for what both teachers learn.

    Raises ArtifactError where its controller cannot be read, ConfigurationError where it falls everywhere.
    """
    teacher = ppo_keys(config.teacher)
    assert teacher.cycles is not None
    own = {f"teacher.{name}": value for name, value in vars(teacher).items()}
    manifest = cycle_manifest(teacher.cycles)
    speeds, shares, _ = shared_ranges(manifest.config, own)
    asked = replace(teacher, speeds=[*speeds], stiffness_shares=[*shares], command_steps=0)
    states, standing = cycle_states(replace(config, teacher=asked), Path(teacher.cycles))
    if not len(states):
        permitted = f"a teacher that does not fall in all of {WORLDS} episodes of {SETTLED + APART * KEPT} steps"
        raise ConfigurationError(refusal("teacher.cycles", teacher.cycles, permitted))
    log.message(
        f"{len(states):,} states of cycles of teacher {manifest.key}, {speeds[0]:g} to {speeds[1]:g} m/s: "
        f"{standing} of {WORLDS} worlds stand; {100 * teacher.cycle_resets:g} % of the episodes begin there"
    )
    return CycleBank(env, states, teacher.cycle_resets)


def cycle_states(config: Config, directory: Path) -> tuple[NDArray[np.float64], int]:
    """States (M, S) of all worlds that stand to the end, by the moment, then by the world; and how many stand."""
    policy = load_phase_policy(directory / "policy.safetensors")
    steps = SETTLED + APART * KEPT
    standing, kept = np.ones(WORLDS, bool), []
    with closing(rom_env(config, num_envs=WORLDS, episode_steps=steps + 1, training=True)) as env:
        observation, _ = env.reset(seed=config.seed + CYCLE_SEED)
        for step in range(1, steps + 1):
            observation, _, terminated, _, info = env.step(policy(observation))
            check_physics(info["diverged"])
            standing &= ~terminated
            if step > SETTLED and (step - SETTLED) % APART == 0:
                kept.append(env.save())
    return np.concatenate([states[standing] for states in kept]), int(standing.sum())
