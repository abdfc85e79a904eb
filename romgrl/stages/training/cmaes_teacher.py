"""A teacher by CMA-ES: a controller with a clock, found generation by generation."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Sequence
from contextlib import ExitStack, closing
from operator import itemgetter
from pathlib import Path

import numpy as np
import torch

from romgrl.artifacts.checkpoint import State
from romgrl.config.schema import Config
from romgrl.config.teachers import CMAESTeacher
from romgrl.errors import ArtifactError
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.checkpoints import TrainingCheckpoints
from romgrl.stages.training.cycle_search import SHORTER, CycleSearch, Task
from romgrl.stages.training.speed_check import SpeedChecks
from romgrl.stages.wiring.commands import searched_tasks
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


class Searches:
    """The searches of a teacher: all of them until SCOUTED of the generations, then the best of them."""

    def __init__(self, teacher: CMAESTeacher, tasks: Sequence[Task], seed: int) -> None:
        self.teacher, self.tasks, self.seed = teacher, tasks, seed
        self.chosen = min(teacher.generations, round(SCOUTED * teacher.generations))
        self.going = {number: self.search(number) for number in range(teacher.scouts)}

    def search(self, number: int) -> CycleSearch:
        """The search of this number, at its beginning."""
        return CycleSearch(self.teacher, self.tasks, self.seed + SEED_STEP * number)

    @property
    def first(self) -> CycleSearch:
        """The one that is checked."""
        return next(iter(self.going.values()))

    def generation(self, number: int) -> dict[str, float]:
        """The next generation of all that go on; what the best of them came to."""
        told = min((search.generation(number) for search in self.going.values()), key=itemgetter("loss"))
        if number == self.chosen:
            best = min(self.going, key=lambda each: self.going[each].loss_of_mean())
            self.going = {best: self.going[best]}
        return told

    def state(self) -> State:
        """What the controllers of those that go on lost, as float64 in base64, and the mean that the first came to."""
        losses = np.array([search.losses for search in self.going.values()])
        return {"numbers": [*self.going], "losses": b64encode(losses.tobytes()).decode(), "mean": self.first.best}

    def restore(self, state: State) -> None:
        """Go on from a state: the generations are learned from again, without a try. ArtifactError for another one."""
        numbers = [int(number) for number in state["numbers"]]
        losses = np.frombuffer(b64decode(state["losses"], validate=True))
        losses = losses.reshape(max(len(numbers), 1), -1, self.teacher.population)
        made, scouts = losses.shape[1], [*range(self.teacher.scouts)]
        known = any(numbers == [each] for each in scouts) if 0 < self.chosen <= made else numbers == scouts
        if not (known and made <= self.teacher.generations and np.isfinite(losses).all()):
            raise ArtifactError(f"{made} generations of searches {numbers} are none of this training")
        self.going = {number: self.search(number) for number in numbers}
        for search, lost in zip(self.going.values(), losses, strict=True):
            search.learn_again(lost)
        if not np.array_equal(self.first.best, np.asarray(state["mean"])):
            raise ArtifactError("the generations do not come to the mean that they came to")


def train_by_cmaes(config: Config, output: Path, log: StageLog) -> None:
    """Write policy.safetensors, checks.csv and curve.csv (through `log`)."""
    torch.set_num_threads(1)
    teacher, path = config.teacher, output / "policy.safetensors"
    assert isinstance(teacher, CMAESTeacher)
    asked, total = searched_tasks(config), teacher.generations
    checks = max(1, CHECKED_EPISODES // (EPISODES * len(asked)))
    watch = SpeedChecks.of(config, output, log, interval=max(1, total // (2 * checks)), total=total, episodes=EPISODES)
    worlds, steps = teacher.population * teacher.rollouts, teacher.search_steps + 1
    with ExitStack() as stack:
        envs = [stack.enter_context(closing(rom_env(at, num_envs=worlds, episode_steps=steps))) for at in asked]
        tasks = [Task(at.teacher.speed, at.teacher.apex, env) for at, env in zip(asked, envs, strict=True)]
        searches = Searches(teacher, tasks, config.seed)
        checkpoints = TrainingCheckpoints(
            output,
            {"searches": searches, "checks": watch},
            save_policy=lambda: save_phase_policy(path, searches.first.mean_policy()),
            seconds=config.checkpoint_seconds,
            total=lambda: total,
            log=log,
        )
        checkpoints.resume()
        with checkpoints.deferring_signals("teacher"):
            for generation in range(len(searches.first.losses) + 1, total + 1):
                told = searches.generation(generation)
                log.metrics(told, generation)
                log.progress(generation, total, loss=told["loss"], upright=told["upright"])
                watch.check_if_due(generation, searches.first)
                checkpoints.save_if_due(generation)
        search = searches.first
    watch.keep_best(search)
    save_phase_policy(path, search.mean_policy())
