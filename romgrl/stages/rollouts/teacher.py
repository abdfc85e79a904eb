"""The deterministic teacher on the reduced-order model, as a reference has it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.recording import record
from romgrl.gait.reference_check import check_reference
from romgrl.stages.wiring.jumps_asked import jumps_asked
from romgrl.stages.wiring.rom import rom_env, rom_parameters
from romgrl.stages.wiring.seeds import REFERENCE_SEED
from romgrl.stages.wiring.teacher_policy import read_teacher

CORRECTIONS = 2
"""How often a teacher of a range is told another speed or apex."""
SPEED_WITHIN, APEX_WITHIN = 0.01, 0.005
"""How far off it may stay: m/s, or a share of the speed where that is more; m."""


class Told(NamedTuple):
    """Episodes of a teacher, and the configuration with the speed and apex that it was told."""

    gait: Gait
    config: Config

    def words(self, asked: Config) -> str:
        """What it was told instead of what is asked for; nothing where that is the same."""
        told, goal = self.config.teacher, asked.teacher
        if told.apex != goal.apex:
            return f", told {told.apex:.3g} m for an apex of {goal.apex:g} m"
        return f", told {told.speed:.3g} m/s to hold {goal.speed:g} m/s" if told.speed != goal.speed else ""


def roll_out_as_asked(directory: Path, config: Config) -> Told:
    """Episodes as near to the configured speed, or apex, as the teacher gets, see `roll_out_teacher`.

    One policy of a range goes some speeds a few per cent slow or fast. Its command is an input like any other, so it is
    told the difference, too, within its range. Of up to three tries the one with the fewest falls is kept, of these one
    that is fit to be imitated, of these the nearest to the goal.
    """
    best = Told(roll_out_teacher(directory, config), config)
    teacher = config.teacher
    goal, limits = ("apex", teacher.apexes) if teacher.apexes else ("speed", teacher.speeds)
    if limits is None:
        return best
    told = asked = float(getattr(teacher, goal))
    within = APEX_WITHIN if teacher.apexes else SPEED_WITHIN * max(1.0, asked)
    off = missed(best.gait, config)
    for _ in range(CORRECTIONS):
        corrected = min(max(told - off, limits[0]), limits[1])
        if not within < abs(off) < math.inf or corrected == told:
            break
        goals: dict[str, Any] = {goal: corrected}
        told, at = corrected, replace(config, teacher=replace(teacher, **goals))
        found = Told(roll_out_teacher(directory, at), at)
        off = missed(found.gait, config)
        best = min(best, found, key=lambda each: order_of_try(each.gait, config))
    return best


def order_of_try(gait: Gait, config: Config) -> tuple[int, bool, float]:
    """What is wrong with episodes, the worst first: falls, whether they are refused as a reference, and how far the
    speed, m/s, or the apexes, m, are from what is asked for."""
    try:
        check_reference(gait, FOOTFALLS[config.teacher.gait])
        refused = False
    except ArtifactError:
        refused = True
    off = abs(missed(gait, config))
    if config.teacher.apexes:
        off = jumps_asked(config, gait, rom_parameters(config)).get("jump_apex_error_m", math.inf)
    return int(gait.fallen.sum()), refused, off if math.isfinite(off) else math.inf


def missed(gait: Gait, config: Config) -> float:
    """How far the valid steps are above the speed, m/s, or the apex, m, that is asked for; infinite where none tell."""
    if config.teacher.apexes:
        off = jumps_asked(config, gait, rom_parameters(config)).get("jump_apex_m", math.nan) - config.teacher.apex
        return off if math.isfinite(off) else math.inf
    assert gait.velocity is not None
    return float(gait.velocity[gait.valid].mean()) - config.teacher.speed if gait.valid.any() else math.inf


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
