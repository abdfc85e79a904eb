"""The deterministic teacher on the reduced-order model, as a reference has it."""

from __future__ import annotations

import math
from pathlib import Path

from romgrl.config.schema import Config
from romgrl.gait.features import Gait
from romgrl.gait.recording import record
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.seeds import REFERENCE_SEED
from romgrl.stages.wiring.teacher_policy import read_teacher


def roll_out_teacher(directory: Path, config: Config) -> Gait:
    """Episodes from several resets, without what comes before the gait is steady. Raises ArtifactError."""
    reference = config.reference
    steps = reference.warmup_steps + math.ceil(reference.steps / reference.episodes)
    env = rom_env(config, num_envs=reference.episodes, episode_steps=steps + 1)
    policy = read_teacher(directory, config, env)
    gait = record(env, policy, steps=steps, seed=config.seed + REFERENCE_SEED, dt=env.dt)
    env.close()
    gait.valid[:, : reference.warmup_steps] = False
    return gait
