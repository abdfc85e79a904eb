"""A teacher by CMA-ES: a controller with a clock, found generation by generation."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import torch

from romgrl.config.schema import Config
from romgrl.config.teachers import CMAESTeacher
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.cycle_search import CycleSearch
from romgrl.stages.training.speed_check import SpeedChecks
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import save_phase_policy

CHECKS, EPISODES = 40, 40
"""How often a search checks its mean over its second half, and in how many episodes: what falls seldom falls."""


def train_by_cmaes(config: Config, output: Path, log: StageLog) -> None:
    """Write policy.safetensors, checks.csv and curve.csv (through `log`).

    A search takes less than a checkpoint's time: one that is stopped starts again.
    """
    torch.set_num_threads(1)
    teacher = config.teacher
    assert isinstance(teacher, CMAESTeacher)
    worlds = teacher.population * teacher.rollouts
    env = rom_env(config, num_envs=worlds, episode_steps=teacher.search_steps + 1, training=True)
    total = teacher.generations
    checks = SpeedChecks.of(config, output, log, interval=max(1, total // (2 * CHECKS)), total=total, episodes=EPISODES)
    with closing(env):
        search = CycleSearch(teacher, env, config.seed)
        for generation in range(1, total + 1):
            told = search.generation(generation)
            log.metrics(told, generation)
            log.progress(generation, total, loss=told["loss"], upright=told["upright"])
            checks.check_if_due(generation, search)
    checks.keep_best(search)
    save_phase_policy(output / "policy.safetensors", search.mean_policy())
