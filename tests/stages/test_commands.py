"""A teacher of a range of speeds: what its worlds are asked for, where it is checked, and that it is one artifact."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from romgrl.config.schema import Config
from romgrl.provenance.stage_keys import stage_settings
from romgrl.rom.parameters import Commands
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import teacher
from romgrl.stages.training import speed_check
from romgrl.stages.training.speed_check import off, rank, worst
from romgrl.stages.wiring.commands import GRID, asked, asked_in_training, checked_tasks, name_of_task, searched_tasks
from romgrl.stages.wiring.rom import rom_env
from tests.conftest import Composer

LEGS = ("rom=variable_leg", "threads=1")
RANGES = (*LEGS, "teacher.speeds=[2,5]", "teacher.stiffness_shares=[0.7,1.4]", "teacher.command_steps=90")


@pytest.fixture
def ranging(compose_config: Composer) -> Config:
    """A teacher of speeds and stiffnesses."""
    return compose_config(*RANGES)


def test_what_is_asked(compose_config: Composer, ranging: Config) -> None:
    one = compose_config()
    assert (asked(one), asked_in_training(one)) == (4.0, 4.0)
    assert asked(ranging) == 4.0
    assert asked_in_training(ranging) == Commands((2.0, 5.0), (0.7, 1.4), 90)
    soft = compose_config(*LEGS, "teacher.stiffness_share=0.8")
    assert asked(soft) == asked_in_training(soft) == Commands((4.0, 4.0), (0.8, 0.8))
    jumping = compose_config("teacher=jumping", "threads=1")
    assert asked(jumping) == Commands((0.0, 0.0), apex=(0.3, 0.3))
    assert asked_in_training(jumping) == Commands((0.0, 0.0), apex=(0.1, 0.5))
    assert [name_of_task(task) for task in checked_tasks(jumping)][::2] == [
        f"teacher to {apex} m" for apex in (0.1, 0.3, 0.5)
    ]
    tasks = checked_tasks(ranging)
    speeds, shares = np.array([(task.teacher.speed, task.teacher.stiffness_share) for task in tasks]).T
    assert sorted(set(speeds)) == np.linspace(2, 5, GRID).tolist()
    assert set(shares) == {0.7, 1.4}
    assert name_of_task(tasks[0]) == "teacher at 2 m/s, stiffness x 0.7"
    assert [name_of_task(task) for task in checked_tasks(one)] == ["teacher"]


def test_a_search_tries_the_usual_stiffness_between_its_ends(compose_config: Composer, ranging: Config) -> None:
    tasks = [(task.teacher.speed, task.teacher.stiffness_share) for task in searched_tasks(ranging)]
    assert sorted(tasks) == [*product(np.linspace(2, 5, GRID).tolist(), (0.7, 1.0, 1.4))]
    softer = replace(ranging, teacher=replace(ranging.teacher, stiffness_shares=[0.7, 1.0]))
    for config in (softer, compose_config("teacher=jumping", "threads=1"), compose_config()):
        assert searched_tasks(config) == checked_tasks(config)


def test_worlds_are_asked_for_it(ranging: Config) -> None:
    column = rom_env(ranging, num_envs=1, episode_steps=10).observation_names.index("target_speed")
    for training, spread in ((True, 2.5), (False, 0.0)):
        env = rom_env(ranging, num_envs=64, episode_steps=10, training=training)
        targets = env.reset(seed=0)[0][:, column] * np.sqrt(9.81 * env.parameters.leg_length)
        assert np.ptp(targets) >= spread
        assert targets.min() >= 2.0 - 1e-5
        assert targets.max() <= 5.0 + 1e-5
        assert training or targets == pytest.approx(4.0)


def test_a_teacher_of_a_range_is_the_same_whatever_is_asked_of_it(compose_config: Composer) -> None:
    asked_for = ("teacher.speed=3", "teacher.stiffness_share=0.9")
    for stage, same in (("teacher", True), ("reference", False)):
        one, other = (stage_settings(stage, compose_config(*RANGES, *more)) for more in ((), asked_for))
        assert (one == other) is same
    assert "teacher.speed" in stage_settings("teacher", compose_config(*LEGS))


def test_an_apex_that_is_missed_counts_as_a_speed_does() -> None:
    row = {
        "falls": 0.0,
        "speed_error_percent": 1.0,
        "steady_speed_m_per_s": 0.01,
        "jump_apex_error_m": 0.02,
        "step": 1.0,
    }
    late, low, none = row | {"step": 2.0}, row | {"jump_apex_error_m": 0.06}, row | {"jump_apex_error_m": np.nan}
    assert [off(each) for each in (row, low, none)] == pytest.approx([2 / 3, 2.0, np.inf])
    assert sorted([none, low, row, late], key=rank) == [late, row, low, none]
    assert worst([row, low, late])["jump_apex_error_m"] == 0.06


def test_the_worst_of_a_range_counts() -> None:
    rows = [{"falls": 1.0, "speed_error_percent": error, "steady_speed_m_per_s": 4.0} for error in (1.0, -5.0, 4.0)]
    assert worst(rows) == {"falls": 3.0, "speed_error_percent": -5.0, "steady_speed_m_per_s": 4.0}
    rows[0]["speed_error_percent"] = float("nan")
    assert np.isnan(worst(rows)["speed_error_percent"])
    assert worst(rows[1:2]) == rows[1]


def test_a_short_training_writes_a_row_for_each(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name, value in ((speed_check, "WORLDS", 2), (speed_check, "STEPS", 30), (speed_check, "STEADY", 5)):
        monkeypatch.setattr(module, name, value)
    for name, value in {"CHECK_EPISODES": 2, "STEPS": 30, "STEADY": 30}.items():
        monkeypatch.setattr(teacher, name, value)
    small = ("teacher.total_steps=2048", "teacher.rollout_steps=16", "teacher.check_steps=1024")
    config = compose_config(*RANGES, *small, "teacher.work_cost=0.1")
    teacher.run(config, {}, tmp_path, SilentLog())
    rows = pd.read_csv(tmp_path / "gait.csv")
    assert rows.walker.tolist() == [name_of_task(task) for task in checked_tasks(config)]
    assert pd.read_csv(tmp_path / speed_check.FILE).falls.max() <= 2 * 2 * GRID
