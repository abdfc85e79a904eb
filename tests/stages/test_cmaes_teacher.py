"""teacher=cmaes: a search on the native engine, its controller in a file, its artifact like any teacher's."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms.policy_file import NETWORK
from romgrl.artifacts import load_tensors, save_tensors
from romgrl.config.schema import Config
from romgrl.config.teachers import CMAESTeacher
from romgrl.errors import ArtifactError
from romgrl.rom.phase_policy import DEVIATION, MEAN, PhasePolicy
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import reference, teacher
from romgrl.stages.training import cmaes_teacher, speed_check
from romgrl.stages.training.cycle_search import CycleSearch, TouchdownTimes
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import load_phase_policy, save_phase_policy
from tests.conftest import Composer

SMALL = ("teacher=cmaes", "threads=1", "teacher.population=8", "teacher.rollouts=2", "teacher.search_steps=80")


def search_of(config: Config) -> CycleSearch:
    """A search and its worlds."""
    keys = config.teacher
    assert isinstance(keys, CMAESTeacher)
    env = rom_env(config, num_envs=keys.population * keys.rollouts, episode_steps=keys.search_steps + 1)
    return CycleSearch(keys, env, config.seed)


def test_times_between_touchdowns() -> None:
    """World 0 steps evenly, world 1 limps, world 2 falls: what follows counts in neither."""
    moments = np.array([[0.1, 0.4, 0.7, 1.0], [0.1, 0.3, 0.7, 0.9], [0.1, 0.2, 0.3, 0.4]])
    times = TouchdownTimes.of(np.array([1.0, 1.0, 1.0]))
    for step, moment in enumerate(moments.T):
        side = np.full(3, -1.0 if step % 2 == 0 else 1.0)
        times.add(side, moment, np.array([True, True, step < 1]))
        times.add(side, moment, np.array([True, True, step < 1]))  # no touchdown in this step
    np.testing.assert_array_equal(times.count, [3, 3, 0])
    gaps = np.array([0.2, 0.4, 0.2])
    np.testing.assert_allclose(times.spread(), [0.0, gaps.std() / gaps.mean(), 0.5], atol=1e-7)


def test_a_search_improves_and_has_the_same_bits_again(compose_config: Composer) -> None:
    config = compose_config(*SMALL, "teacher.generations=60")
    one, other = (search_of(config) for _ in range(2))
    told = [one.generation(number) for number in range(1, 61)]
    assert [other.generation(number) for number in range(1, 61)] == told
    np.testing.assert_array_equal(one.best, other.best)
    assert [one.steps_of(number) for number in (1, 10, 30)] == [20, 40, 80]
    first, last = (one.tries(parameters[None].repeat(8, axis=0), 80, seed=1) for parameters in (MEAN, one.best))
    assert last.reward.mean() > first.reward.mean() + 0.02
    assert last.upright.mean() > first.upright.mean()


def test_the_mean_reward_ends_with_a_fall(compose_config: Composer) -> None:
    search = search_of(compose_config(*SMALL, "teacher.work_cost=0"))
    limp = MEAN - 100 * DEVIATION
    tries = search.tries(np.array([limp] * 8), 80, seed=1)
    assert tries.upright.max() < 0.9
    assert tries.reward.max() <= tries.upright.max()
    assert search.losses(tries).min() > 0


@pytest.fixture
def _short_check(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"STEPS": 30, "STEADY": 5}.items():
        monkeypatch.setattr(speed_check, name, value)
    for name, value in {"CHECK_EPISODES": 3, "STEPS": 30, "STEADY": 30}.items():
        monkeypatch.setattr(teacher, name, value)
    monkeypatch.setattr(cmaes_teacher, "EPISODES", 4)


@pytest.mark.usefixtures("_short_check")
def test_the_stage_leaves_a_teachers_artifact(compose_config: Composer, tmp_path: Path) -> None:
    config = compose_config(*SMALL, "teacher.generations=4", "reference.steps=100", "reference.warmup_steps=1")
    log = SilentLog()
    teacher.run(config, {}, tmp_path, log)
    assert [step for step, _ in log.rows] == [1, 2, 3, 4]
    assert {"loss", "reward", "limp", "upright"} <= log.rows[0][1].keys()
    checks = pd.read_csv(tmp_path / "checks.csv")
    assert checks.step.tolist() == [2, 3, 4]
    assert pd.read_csv(tmp_path / "gait.csv").walker.tolist() == ["teacher"]
    load_phase_policy(tmp_path / "policy.safetensors")
    (tmp_path / "reference").mkdir()
    with pytest.raises(ArtifactError, match="falls"):  # four generations do not walk
        reference.run(config, {"teacher": tmp_path}, tmp_path / "reference", log)


def test_a_controller_comes_back_from_its_file_and_no_other_does(tmp_path: Path) -> None:
    path, policy = tmp_path / "policy.safetensors", PhasePolicy(MEAN + 0.1)
    save_phase_policy(path, policy)
    np.testing.assert_array_equal(load_phase_policy(path).parameters, policy.parameters)
    tensors, metadata = load_tensors(path)
    spec = json.loads(metadata[NETWORK])
    nan = {"parameters": torch.full((20,), float("nan"), dtype=torch.float64)}
    for kept, said, line in (
        (tensors, spec | {"algorithm": "ppo"}, "algorithm ppo; needed: cmaes"),
        (tensors, {"algorithm": "cmaes"}, "does not describe its controller"),
        (tensors, spec | {"observation_names": ["height"]}, "column 0 of what it reads is height"),
        ({"parameters": tensors["parameters"][:5]}, spec, r"parameters is torch.float64 \(5,\)"),
        (nan, spec, "not finite"),
        ({}, spec, "no tensor parameters"),
    ):
        save_tensors(path, kept, {NETWORK: json.dumps(said)})
        with pytest.raises(ArtifactError, match=line):
            load_phase_policy(path)


@pytest.mark.slow
def test_a_whole_search_finds_a_run(compose_config: Composer, tmp_path: Path) -> None:
    """Three seeds had 3 to 10 falls in 100 episodes of 33 s, 3.96 to 3.99 m/s, a correlation of -0.98."""
    teacher.run(compose_config("teacher=cmaes", "threads=1"), {}, tmp_path, SilentLog())
    row = pd.read_csv(tmp_path / "gait.csv").iloc[0]
    assert row.falls <= 25
    assert row.steady_speed_m_per_s == pytest.approx(4.0, rel=0.03)
    assert row.left_right_correlation < -0.9
    assert 1.3 <= row.stride_frequency_hz <= 1.8
