"""When a teacher's speed is checked, which policy is kept, and how a resumed training goes on."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms.ppo_policy import load_ppo_policy
from romgrl.config.schema import Config
from romgrl.gait.features import Gait
from romgrl.gait.recording import record
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import teacher
from romgrl.stages.training import speed_check
from romgrl.stages.training.speed_check import STEADY, SpeedChecks, measure, rank
from romgrl.stages.wiring.rom import rom_env
from tests.conftest import Composer

Row = dict[str, float]


def row(step: float, speed_error: float, falls: float = 0.0) -> Row:
    return {"step": step, "falls": falls, "speed_error_percent": speed_error}


@pytest.mark.parametrize(
    ("rows", "kept"),
    [
        ([row(1, 0.1), row(2, -2.9), row(3, 3.1)], 2),  # within the limit the last one counts
        ([row(1, 8.0), row(2, -5.0), row(3, 6.0)], 2),  # beyond it the nearest
        ([row(1, 9.0), row(2, 0.0, falls=1)], 1),
        ([row(1, float("nan"), falls=8), row(2, 40.0, falls=8)], 2),
    ],
)
def test_rank_wants_no_fall_then_the_speed_then_the_last(rows: list[Row], kept: int) -> None:
    assert min(rows, key=rank)["step"] == kept


def test_speed_is_that_of_the_end_of_the_episodes_that_do_not_fall() -> None:
    velocity = np.full((3, STEADY + 50), 9.0)
    velocity[0, -STEADY:], velocity[1, -STEADY:], velocity[2] = 4.1, 4.3, 0.5
    upright = np.ones(velocity.shape, bool)
    upright[2, 10:] = False
    gait = Gait(np.zeros((*velocity.shape, 5)), upright, ~upright[:, -1], 1 / 30, velocity=velocity)
    found = measure(gait, 4.0)
    assert found == pytest.approx({"falls": 1, "steady_speed_m_per_s": 4.2, "speed_error_percent": 5.0})
    gait.fallen[:] = True
    assert np.isnan(measure(gait, 4.0)["steady_speed_m_per_s"])


class Agent:
    """Stands for an agent whose weights are its number of steps."""

    def __init__(self, step: float) -> None:
        self.policy = SimpleNamespace(num_envs=8, flat=torch.full((3,), float(step)))

    def mean_policy(self) -> None:
        return None

    def policy_vector(self) -> torch.Tensor:
        return self.policy.flat.clone()

    def put_policy_vector(self, vector: torch.Tensor) -> None:
        self.policy.flat.copy_(vector)


def checks(config: Config, output: Path, errors: list[float], monkeypatch: pytest.MonkeyPatch) -> SpeedChecks:
    """Checks that find one of `errors` after the other."""
    found = iter(errors)
    monkeypatch.setattr(speed_check, "record", lambda *_, **__: SimpleNamespace(valid=np.ones((8, 1000), bool)))
    monkeypatch.setattr(
        speed_check,
        "measure",
        lambda *_: {"falls": 0.0, "steady_speed_m_per_s": 4.0, "speed_error_percent": next(found)},
    )
    env: Any = SimpleNamespace(num_envs=8, close=lambda: None, dt=1 / 30, parameters=None)
    return SpeedChecks(100, config, [(config, env)], output, SilentLog(), due=500)


def test_second_half_at_intervals_and_the_best_is_kept(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = checks(compose_config(), tmp_path, [5.0, 2.0, 1.0, 7.0, 9.0], monkeypatch)
    for step in range(64, 1000, 64):
        made.check_if_due(step, Agent(step))
    steps = [512, 640, 768, 896]
    assert [found["step"] for found in made.rows] == steps
    assert list(pd.read_csv(tmp_path / speed_check.FILE)["step"]) == steps
    last = Agent(1000)
    made.keep_best(last)
    assert last.policy.flat.tolist() == [768.0] * 3


def test_a_resumed_training_goes_on_with_its_checks(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = checks(compose_config(), tmp_path, [1.0, 9.0], monkeypatch)
    first.check_if_due(512, Agent(512))
    second = checks(compose_config(), tmp_path, [9.0], monkeypatch)
    second.restore(first.state())
    second.check_if_due(576, Agent(576))
    assert len(second.rows) == 1
    second.check_if_due(640, Agent(640))
    last = Agent(0)
    second.keep_best(last)
    assert last.policy.flat.tolist() == [512.0] * 3
    fresh = checks(compose_config(), tmp_path, [], monkeypatch)
    fresh.restore(fresh.state())
    assert fresh.best is None


@pytest.mark.parametrize("normalised", [False, True])
def test_the_kept_policy_is_the_one_that_was_measured(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, normalised: bool
) -> None:
    """A short real training: what the file holds walks as the best row says."""
    for name, value in {"WORLDS": 2, "STEPS": 60, "STEADY": 5}.items():
        monkeypatch.setattr(speed_check, name, value)
    monkeypatch.setattr(teacher, "CHECK_EPISODES", 2)
    monkeypatch.setattr(teacher, "STEPS", 60)
    monkeypatch.setattr(teacher, "STEADY", 60)
    config = compose_config(
        "threads=1", "teacher.total_steps=6144", "teacher.rollout_steps=16", "teacher.check_steps=1024"
    )
    config.teacher.normalize_observation = normalised
    teacher.run(config, {}, tmp_path, SilentLog())
    rows = pd.read_csv(tmp_path / speed_check.FILE).to_dict("records")
    assert [found["step"] for found in rows] == [3072, 4096, 5120, 6144]
    env = rom_env(config, num_envs=2, episode_steps=61)
    policy = load_ppo_policy(tmp_path / "policy.safetensors")
    gait = record(env, policy, steps=60, seed=config.seed + speed_check.CHECK_SEED, dt=env.dt)
    best = min(rows, key=rank)
    assert measure(gait, 4.0)["falls"] == best["falls"]
    assert measure(gait, 4.0)["steady_speed_m_per_s"] == pytest.approx(best["steady_speed_m_per_s"], nan_ok=True)
