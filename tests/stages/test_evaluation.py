"""The evaluation stage: what counts after a fall, replayed power and contact, and the files it writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from romgrl.artifacts import load_arrays, save_arrays
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import POWERS
from romgrl.gait.metrics import ENERGY_MEASURES
from romgrl.gait.null_models import NULL_COLUMNS
from romgrl.humanoid.loads import Loads, replay
from romgrl.humanoid.model import build, configured, dimensions, fingerprint
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import evaluation
from romgrl.stages.rollouts import humanoid
from romgrl.stages.rollouts.humanoid import roll_out
from romgrl.stages.rollouts.other_teacher import other_teacher
from romgrl.stages.wiring.artifact_arrays import DISTANCE_COLUMNS
from romgrl.stages.wiring.rom import rom_parameters
from tests.conftest import Composer
from tests.helpers.synthetic_gait import DT, run
from tests.helpers.walkers import write_walker


class TwoWalkers:
    """Row 0 stays upright; row 1 falls at step 3 and is reset. Observation and features count steps."""

    num_envs, substeps, control_step = 2, 1, DT
    model = SimpleNamespace(nu=21)
    step_count = 0

    def reset(self, *, seed: int) -> tuple[NDArray[np.float32], dict[str, Any]]:
        self.seed, self.step_count = seed, 0
        return np.zeros((2, 358), np.float32), {}

    def states(self) -> NDArray[np.float64]:
        return np.full((2, 48), float(self.step_count))

    def step(self, action: NDArray[np.float32]) -> tuple[Any, ...]:
        assert action.shape == (2, 21)
        terminated = np.array([False, self.step_count == 3])
        info = {
            "features": np.full((2, 5), self.step_count, np.float32),
            "forward_velocity": np.full(2, 4, np.float32),
            "trunk_lean": np.zeros(2, np.float32),
        }
        self.step_count += 1
        return np.zeros((2, 358), np.float32), np.zeros(2), terminated, np.zeros(2, bool), info


def test_nothing_after_a_fall_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    replayed: list[int] = []

    def fake_replay(model: object, states: NDArray[np.float64], actions: object, substeps: int) -> Loads:
        replayed.append(len(states))
        loads = Loads.empty(len(states), substeps=substeps)
        for values in loads.arrays().values():
            values[:] = 7
        return loads

    monkeypatch.setattr(humanoid, "replay", fake_replay)
    env, seen = TwoWalkers(), []
    arrays = roll_out(
        env,
        lambda observation: np.zeros((len(observation), 21), np.float32),
        steps=10,
        seed=5,
        progress=seen.append,
    )
    assert (env.seed, seen) == (5, list(range(1, 11)))
    np.testing.assert_array_equal(arrays["upright"], [[True] * 10, [True] * 3 + [False] * 7])
    np.testing.assert_array_equal(arrays["features"][0, :, 2], np.arange(10))
    assert replayed == [10, 3]
    for name in ("power", "positive_power", "stop_share"):
        np.testing.assert_array_equal(arrays[name].sum(axis=1), [70, 21])
    for name in ("contact", "touching", "loaded", "sliding", "ankle_stop"):
        np.testing.assert_array_equal(arrays[name].reshape(2, 10, -1).all(axis=2), arrays["upright"])
    np.testing.assert_array_equal(arrays["states"][:, 0], np.arange(10))


def test_replayed_power_is_torque_times_angle() -> None:
    model = build(actuation="torque", substeps=16)
    data = mujoco.MjData(model)
    data.qpos[1], data.qpos[3:] = 2.0, model.jnt_range[3:].mean(axis=1)  # in the air, at rest, off the stops
    state = np.concatenate((data.qpos, data.qvel))
    action = np.zeros(model.nu)
    assert replay(model, state[None], action[None], 16).power[0] == 0.0
    actuator = model.actuator("L_Knee").id
    action[actuator] = 0.2
    joint = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
    loads = replay(model, state[None], action[None], 16)
    data.ctrl[:] = action
    torque, speeds = [], [0.0]
    for _ in range(16):
        mujoco.mj_step(model, data)
        torque.append(data.qfrc_actuator[joint])
        speeds.append(data.qvel[joint])
    assert np.ptp(torque) < 1e-9  # constant, so that work = torque x angle, of a speed that changes evenly in a substep
    work = abs(torque[0] * np.trapezoid(speeds, dx=model.opt.timestep))
    assert work > 0
    assert loads.power[0] == pytest.approx(work * 30.0, rel=1e-6)
    assert loads.positive_power[0] == pytest.approx(work * 30.0, rel=1e-6)
    assert not loads.contact.any()


def test_replayed_contact_of_a_standing_humanoid() -> None:
    model = build()
    states = np.zeros((2, model.nq + model.nv))
    states[:, 1] = dimensions(model).pelvis_height + np.array([-0.005, 0.1])
    contact = replay(model, states, np.zeros((2, model.nu)), 1).contact
    np.testing.assert_array_equal(contact, [[True, True], [False, False]])


def test_stage_writes_the_fixed_files(smoke_config: Config, tmp_path: Path) -> None:
    config = smoke_config
    inputs = {name: tmp_path / name for name in ("reference", "student", "baseline")}
    for path in inputs.values():
        path.mkdir()
    watts = dict(zip(POWERS, (400.0, 300.0, 100.0, 90.0), strict=True))
    write_reference(inputs["reference"], **{name: np.full(360, watt, np.float32) for name, watt in watts.items()})
    for seed, name in enumerate(("student", "baseline")):
        write_walker(inputs[name] / "policy.safetensors", seed=seed, humanoid=fingerprint(configured(config.humanoid)))
    log = SilentLog()
    evaluation.run(config, inputs, tmp_path, log)
    size = (config.evaluation.episodes, config.evaluation.steps)
    rollouts = load_arrays(tmp_path / "rollouts.npz")
    for name in ("student", "baseline"):
        assert rollouts[f"{name}_features"].shape == (*size, 5)
        assert rollouts[f"{name}_contact"].shape == (*size, 2)
        upright = rollouts[f"{name}_upright"]
        np.testing.assert_array_equal(upright, np.logical_and.accumulate(upright, axis=1))
        assert len(rollouts[f"{name}_states"]) == max(1, upright.sum(axis=1).max())
    np.testing.assert_array_equal(rollouts["student_states"][0], rollouts["baseline_states"][0])  # the same resets
    errors, gaits = pd.read_csv(tmp_path / "mse.csv"), pd.read_csv(tmp_path / "gait.csv")
    assert len(errors) == 18
    distances = pd.read_csv(tmp_path / "distances.csv")
    assert set(distances) >= set(DISTANCE_COLUMNS)
    assert distances.teacher_floor[distances.distance != "mmd"].notna().all()  # mmd: two episodes on each side
    assert set(distances.note) == set(errors.note)
    assert list(gaits.walker) == ["teacher", "student", "baseline"]
    teacher = gaits.set_index("walker").loc["teacher"]
    assert teacher.stride_frequency_hz == pytest.approx(1.75, rel=0.01)
    assert teacher.phase_lag_s == pytest.approx(0.0, abs=1e-6)
    mass = rom_parameters(config).mass
    assert teacher[list(ENERGY_MEASURES)].tolist() == pytest.approx(
        [400 / (mass * 9.81 * 4), 300 / (mass * 9.81 * 4), 300 / mass, 210 / mass], rel=1e-5
    )
    walkers = gaits.set_index("walker").loc[["student", "baseline"]]
    assert walkers[["cost_without_retraction", "positive_power_without_retraction_w_per_kg"]].isna().all(axis=None)
    assert (gaits.target_speed_m_per_s == 4.0).all()
    nulls = pd.read_csv(tmp_path / "null_models.csv")
    assert list(nulls) == [*NULL_COLUMNS]
    assert list(dict.fromkeys(nulls.walker))[:1] == ["teacher"]
    assert set(nulls.walker) >= {"teacher", "student", "sinusoid", "statue", "baseline"}
    scores = nulls[nulls.measure == "error_over_variance"].set_index(["walker", "channel"])["value"]
    assert scores["teacher", "average"] == pytest.approx(0.0, abs=0.02)
    assert scores["statue", "left_foot_x"] == pytest.approx(1.0, rel=0.05)
    absent = [text for text in log.messages if text.startswith("no null model other_teacher: ")]
    assert absent == [
        "no null model other_teacher: the teacher that ships was trained with teacher.hidden_sizes "
        "[128, 128], not [32, 32]"
    ]
    assert "statue" in log.messages[-1]


def test_another_seeds_teacher_is_the_one_that_ships(compose_config: Composer, tmp_path: Path) -> None:
    """It is no row where it is the one in use, walks another model or is damaged."""
    config = compose_config("reference.steps=240", "reference.episodes=2", "reference.warmup_steps=60", "threads=1")
    features, _ = run(episodes=2, steps=120, frequency=1.75)
    found = other_teacher(config, list(features))
    assert [episode.shape for episode in found] == [(120, 5)] * 2
    assert np.ptp(found[0][:, 1]) > 0.5  # its feet swing
    with pytest.raises(ArtifactError, match="the teacher that ships is the one in use"):
        other_teacher(config, [episode[:100] + 1e-5 for episode in found])
    with pytest.raises(ArtifactError, match=r"trained with teacher.speed 4.0, not 1.0"):
        other_teacher(replace(config, teacher=replace(config.teacher, speed=1.0)), list(features))
    with pytest.raises(ArtifactError, match=r"trained with rom.stiffness 14000.0, not 9000.0"):
        other_teacher(replace(config, rom=replace(config.rom, stiffness=9000.0)), list(features))


def test_a_reference_that_does_not_fit_is_refused(smoke_config: Config, tmp_path: Path) -> None:
    write_reference(tmp_path, dt=1 / 50)
    with pytest.raises(ArtifactError, match=r"reference.npz: dt 0.02; needed: 0.0333333"):
        evaluation.run(smoke_config, {"reference": tmp_path}, tmp_path, SilentLog())
    save_arrays(tmp_path / "reference.npz", {"features": np.zeros((10, 5)), "dt": DT})
    with pytest.raises(ArtifactError, match="no array episode, speed"):
        evaluation.run(smoke_config, {"reference": tmp_path}, tmp_path, SilentLog())


def write_reference(directory: Path, dt: float = DT, **powers: NDArray[np.float32]) -> None:
    features, contact = run(episodes=3, steps=120, frequency=1.75)
    arrays = {
        "features": features.reshape(-1, 5),
        "episode": np.repeat(np.arange(3, dtype=np.int32), 120),
        "contact": contact.reshape(-1, 2),
        "velocity": np.full(360, 4.0),
        "dt": dt,
        "speed": 4.0,
    }
    save_arrays(directory / "reference.npz", arrays | powers)
