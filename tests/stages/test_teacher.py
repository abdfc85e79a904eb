"""The teacher and reference stages on the real reduced-order model."""

import csv
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from romgrl.algorithms.ppo_policy import load_ppo_policy
from romgrl.artifacts import load_arrays, load_tensors
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, DivergenceError
from romgrl.gait.features import POWERS
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import reference, teacher
from romgrl.stages.wiring.rom import rom_parameters
from tests.conftest import Composer

SMALL = (
    "threads=1",
    "teacher.total_steps=5120",
    "teacher.num_envs=8",
    "teacher.rollout_steps=64",
    "teacher.minibatch_size=128",
    "teacher.hidden_sizes=[32]",
)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def _short_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(teacher, "CHECK_EPISODES", 4)
    monkeypatch.setattr(teacher, "STEPS", 100)
    monkeypatch.setattr(teacher, "STEADY", 100)


def train(config: Config, output: Path) -> SilentLog:
    log = SilentLog()
    output.mkdir()
    teacher.run(config, {}, output, log)
    return log


@pytest.mark.usefixtures("_short_check")
def test_two_runs_of_5000_steps_give_identical_weights(compose_config: Composer, tmp_path: Path) -> None:
    logs = [train(compose_config(*SMALL), tmp_path / name) for name in ("first", "second")]
    first, second = (load_tensors(tmp_path / name / "policy.safetensors")[0] for name in ("first", "second"))
    assert all(torch.equal(tensor, second[name]) for name, tensor in first.items())
    assert logs[0].rows == logs[1].rows
    assert logs[0].rows[-1][0] >= 5000
    train(compose_config(*SMALL, "seed=1"), tmp_path / "third")
    assert not torch.equal(load_tensors(tmp_path / "third" / "policy.safetensors")[0]["0.weight"], first["0.weight"])


@pytest.mark.usefixtures("_short_check")
def test_stage_writes_policy_curve_and_gait(compose_config: Composer, tmp_path: Path) -> None:
    log = train(compose_config(*SMALL, "teacher.total_steps=1000"), tmp_path / "run")
    policy = load_ppo_policy(tmp_path / "run" / "policy.safetensors")
    assert policy(np.zeros((3, 20), np.float32)).shape == (3, 2)
    with (tmp_path / "run" / "gait.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert row["walker"] == "teacher"
    assert float(row["episodes"]) == 4
    assert float(row["target_speed_m_per_s"]) == 4.0
    assert {"speed", "left_right_correlation", "falls", "policy_loss", "value_loss"} <= set(log.rows[-1][1])


def test_divergence_is_an_error(compose_config: Composer, tmp_path: Path) -> None:
    config = compose_config(*SMALL)
    config.teacher.learning_rate = 1e38
    with pytest.raises(DivergenceError, match=r"teacher: .* after step 0"):
        train(config, tmp_path / "run")
    assert not (tmp_path / "run" / "policy.safetensors").exists()


def test_interrupted_training_saves_its_policy(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupt: Callable[..., None]
) -> None:
    monkeypatch.setattr(SilentLog, "progress", interrupt)
    with pytest.raises(KeyboardInterrupt):
        train(compose_config(*SMALL), tmp_path / "run")
    assert load_ppo_policy(tmp_path / "run" / "policy.safetensors")(np.zeros((1, 20), np.float32)).shape == (1, 2)


@pytest.mark.usefixtures("_short_check")
def test_reference_of_an_untrained_teacher_is_refused(compose_config: Composer, tmp_path: Path) -> None:
    config = compose_config(*SMALL, "teacher.total_steps=512")
    train(config, tmp_path / "teacher")
    (tmp_path / "reference").mkdir()
    with pytest.raises(ArtifactError, match="the reference falls"):
        reference.run(config, {"teacher": tmp_path / "teacher"}, tmp_path / "reference", SilentLog())
    assert not (tmp_path / "reference" / "reference.npz").exists()
    unchecked = dataclasses.replace(config, reference=dataclasses.replace(config.reference, check=False))
    log = SilentLog()
    reference.run(unchecked, {"teacher": tmp_path / "teacher"}, tmp_path / "reference", log)
    assert "the reference falls" in log.messages[-1]
    arrays = load_arrays(tmp_path / "reference" / "reference.npz")
    assert arrays["features"].shape == (config.reference.steps, 5)
    power, positive, retraction, positive_retraction = (arrays[name] for name in POWERS)
    assert power.shape == (config.reference.steps,)
    assert (power >= positive).all()
    assert (power >= retraction).all()
    assert (retraction >= positive_retraction).all()
    assert power.max() > 1.0


def test_null_dimensions_come_from_the_humanoid(compose_config: Composer) -> None:
    config = compose_config()
    parameters = rom_parameters(config)
    taller = dataclasses.replace(config, humanoid=dataclasses.replace(config.humanoid, height=1.9, mass=90.0))
    assert rom_parameters(taller).mass == pytest.approx(90.0, abs=0.01)
    assert rom_parameters(taller).leg_length > parameters.leg_length + 0.05
    assert parameters.foot_radius == pytest.approx(0.07, abs=0.03)
    own = dataclasses.replace(config, rom=dataclasses.replace(config.rom, leg_length=1.0))
    assert rom_parameters(own).leg_length == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_default_teacher_runs_at_4_metres_per_second(compose_config: Composer, seed: int, tmp_path: Path) -> None:
    config = compose_config(f"seed={seed}", "threads=2")
    torch.set_num_threads(2)
    assert config.teacher.total_steps <= 1_500_000
    train(config, tmp_path / "teacher")
    with (tmp_path / "teacher" / "gait.csv").open(encoding="utf-8") as file:
        row = {name: float(value) for name, value in next(csv.DictReader(file)).items() if name != "walker"}
    assert row["episodes"] == 100
    assert row["falls"] == 0
    assert row["mean_speed_m_per_s"] == pytest.approx(4.0, rel=0.03)
    assert row["left_right_correlation"] < -0.8
    assert row["touchdown_phase_strides"] == pytest.approx(0.5, abs=0.05)
    assert 0.2 <= row["duty_factor"] <= 0.4
    (tmp_path / "reference").mkdir()
    reference.run(config, {"teacher": tmp_path / "teacher"}, tmp_path / "reference", SilentLog())
    arrays = load_arrays(tmp_path / "reference" / "reference.npz")
    assert arrays["features"].shape == (config.reference.steps, 5)
    assert arrays["features"].dtype == np.float32
    assert arrays["episode"].dtype == np.int32
    assert arrays["dt"] == pytest.approx(1 / 30)
