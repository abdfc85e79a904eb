"""A teacher by CMA-ES: a controller with a clock, found generation by generation."""

from __future__ import annotations

from contextlib import ExitStack, closing
from operator import itemgetter
from pathlib import Path

import torch

from romgrl.config.schema import Config
from romgrl.config.teachers import CMAESTeacher
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.cycle_search import SHORTER, CycleSearch, Task
from romgrl.stages.training.speed_check import SpeedChecks
from romgrl.stages.wiring.commands import checked_tasks
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import save_phase_policy

CHECKED_EPISODES = 1600
"""In how many episodes a search checks its mean over its second half, a few at a time: what falls seldom falls."""
EPISODES = 40
"""Of each check of a task."""
SCOUTED, _ = SHORTER[-1]
"""After this share of the generations, in which tries are short, the best of the searches goes on alone."""
SEED_STEP = 10_007
"""Between the seeds of searches."""


def train_by_cmaes(config: Config, output: Path, log: StageLog) -> None:
    """Write policy.safetensors, checks.csv and curve.csv (through `log`).

    A search takes less than a checkpoint's time: one that is stopped starts again.
    """
    torch.set_num_threads(1)
    teacher = config.teacher
    assert isinstance(teacher, CMAESTeacher)
    asked, total = checked_tasks(config), teacher.generations
    checks = max(1, CHECKED_EPISODES // (EPISODES * len(asked)))
    watch = SpeedChecks.of(config, output, log, interval=max(1, total // (2 * checks)), total=total, episodes=EPISODES)
    worlds, steps = teacher.population * teacher.rollouts, teacher.search_steps + 1
    with ExitStack() as stack:
        envs = [stack.enter_context(closing(rom_env(at, num_envs=worlds, episode_steps=steps))) for at in asked]
        tasks = [Task(at.teacher.speed, at.teacher.apex, env) for at, env in zip(asked, envs, strict=True)]
        searches = [CycleSearch(teacher, tasks, config.seed + SEED_STEP * number) for number in range(teacher.scouts)]
        chosen = min(total, round(SCOUTED * total))
        for generation in range(1, total + 1):
            told = min((each.generation(generation) for each in searches), key=itemgetter("loss"))
            log.metrics(told, generation)
            log.progress(generation, total, loss=told["loss"], upright=told["upright"])
            if generation == chosen:
                searches = [min(searches, key=CycleSearch.loss_of_mean)]
            watch.check_if_due(generation, searches[0])
        search = searches[0]
    watch.keep_best(search)
    save_phase_policy(output / "policy.safetensors", search.mean_policy())
