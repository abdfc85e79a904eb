"""Searches by CMA-ES that take a second: few controllers, short tries, short checks."""

from __future__ import annotations

import pytest

from romgrl.config.schema import Config
from romgrl.config.teachers import CMAESTeacher
from romgrl.stages import teacher
from romgrl.stages.training import cmaes_teacher, speed_check
from romgrl.stages.training.cycle_search import CycleSearch, Task
from romgrl.stages.wiring.commands import checked_tasks
from romgrl.stages.wiring.rom import rom_env

SMALL = ("teacher=cmaes", "threads=1", "teacher.population=8", "teacher.rollouts=2", "teacher.search_steps=80")


def search_of(config: Config) -> CycleSearch:
    """A search and its worlds."""
    keys = config.teacher
    assert isinstance(keys, CMAESTeacher)
    worlds = {"num_envs": keys.population * keys.rollouts, "episode_steps": keys.search_steps + 1}
    tasks = [Task(at.teacher.speed, at.teacher.apex, rom_env(at, **worlds)) for at in checked_tasks(config)]
    return CycleSearch(keys, tasks, config.seed)


def shorten_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let checks, and the table of the gait, look at a second of a few episodes."""
    for name, value in {"STEPS": 30, "STEADY": 5}.items():
        monkeypatch.setattr(speed_check, name, value)
    for name, value in {"CHECK_EPISODES": 3, "STEPS": 30, "STEADY": 30}.items():
        monkeypatch.setattr(teacher, name, value)
    monkeypatch.setattr(cmaes_teacher, "EPISODES", 4)
