"""The deterministic teacher on the reduced-order model, as a reference has it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from romgrl.config.schema import Config
from romgrl.gait.features import Gait
from romgrl.gait.recording import record
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.seeds import REFERENCE_SEED
from romgrl.stages.wiring.teacher_policy import read_teacher

CORRECTIONS, HELD_WITHIN = 2, 0.01
"""How often a teacher of a range is told another speed, and how far off it may stay: m/s, or a share of the speed."""


class HeldSpeed(NamedTuple):
    """Episodes of a teacher, and the configuration with the speed that it was told, m/s."""

    gait: Gait
    told: Config


def roll_out_at_speed(directory: Path, config: Config) -> HeldSpeed:
    """Episodes as near to the configured speed as the teacher gets, see `roll_out_teacher`.

    One policy of a range of speeds holds some a few per cent slow or fast. Its command is an input like any other, so
    it is told the difference, too, within its range. Episodes with the fewest falls, then the nearest speed, are kept.
    """
    asked, limits = config.teacher.speed, config.teacher.speeds
    best = HeldSpeed(roll_out_teacher(directory, config), config)
    if limits is None:
        return best
    told, held = asked, held_speed(best.gait)
    for _ in range(CORRECTIONS):
        corrected = min(max(told + asked - held, limits[0]), limits[1])
        if not HELD_WITHIN * max(1.0, asked) < abs(held - asked) < math.inf or corrected == told:
            break
        at = replace(config, teacher=replace(config.teacher, speed=corrected))
        found = HeldSpeed(roll_out_teacher(directory, at), at)
        told, held = corrected, held_speed(found.gait)
        best = min(best, found, key=lambda each: (each.gait.fallen.sum(), abs(held_speed(each.gait) - asked)))
    return best


def held_speed(gait: Gait) -> float:
    """Mean speed of the valid steps, m/s; infinite where there are none."""
    return float(gait.velocity[gait.valid].mean()) if gait.velocity is not None and gait.valid.any() else math.inf


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
