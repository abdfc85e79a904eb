"""The vector environment: threads, autoreset, divergence, resets, terminations and bad arguments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from romgrl.humanoid import task
from romgrl.humanoid._core import POSTURE_SIZE
from romgrl.humanoid.model import build, lowest_point
from romgrl.humanoid.planar_observer import HEAD_HEIGHT, PELVIS_HEIGHT, TRUNK_LEAN
from romgrl.humanoid.start_states import StrideStates
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

NO_FALL = {"fall_pelvis_height": 0.0, "fall_head_height": 0.0, "fall_trunk_lean": 9.0}


def actions(steps: int, count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (steps, count, 21)).astype(np.float32)


def test_threads_give_the_same_bits() -> None:
    results = []
    for threads in (1, 2, 3):
        env = PlanarHumanoidVectorEnv(num_envs=16, num_threads=threads)
        env.reset(seed=5)
        seen = [env.step(action) for action in actions(40, 16)]
        results.append((env.states(), np.array([step[0] for step in seen]), np.array([step[1] for step in seen])))
        assert sum(step[2].sum() for step in seen) > 0
    for other in results[1:]:
        for ours, theirs in zip(results[0], other, strict=True):
            assert np.array_equal(ours, theirs)


def test_seed_decides_everything() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=4)
    first, _ = env.reset(seed=1)
    assert np.array_equal(first, env.reset(seed=1)[0])
    assert not np.array_equal(first, env.reset(seed=2)[0])


def test_info_belongs_to_the_state_before_the_autoreset() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=16, episode_steps=7)
    env.reset(seed=0)
    finished = np.zeros(16, dtype=bool)
    for action in actions(7, 16):
        observation, reward, terminated, truncated, info = env.step(action)
        running = ~(terminated | truncated)
        assert np.array_equal(observation[running], info["final_obs"][running])
        assert np.array_equal(info["features"][:, 0], info["final_obs"][:, 0])
        assert np.array_equal(info["reset_features"][:, 0], observation[:, 0])
        assert reward == pytest.approx(np.exp(-np.abs(info["forward_velocity"] - 4.0)), abs=1e-6)
        assert not (terminated & truncated).any()
        finished |= terminated
    assert truncated[~finished].all()
    assert {array.dtype for array in (observation, reward, info["features"], info["trunk_lean"])} == {np.dtype("f4")}
    assert observation.shape == (16, 358)


def test_forward_velocity_is_the_mean_over_the_step() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=8, speed=2.0, **NO_FALL)
    env.reset(seed=0)
    before = env.states()[:, 0]
    _, _, _, _, info = env.step(actions(1, 8)[0])
    assert info["forward_velocity"] == pytest.approx((env.states()[:, 0] - before) * 30.0, abs=1e-6)


@pytest.mark.parametrize(("column", "value"), [(24 + 5, np.nan), (3, np.inf), (24 + 7, 1e12), (24 + 7, 5e3)])
def test_divergence_is_detected_and_counted(
    column: int, value: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    env = PlanarHumanoidVectorEnv(num_envs=4, episode_steps=1000)
    env.reset(seed=0)
    states = env.states()
    states[2, column] = value
    env.set_states(states)
    observation, reward, terminated, _, info = env.step(np.zeros((4, 21), dtype=np.float32))
    assert info["diverged"].tolist() == [False, False, True, False]
    assert terminated[2]
    assert reward[2] == 0.0
    assert env.diverged_count == 1
    for array in (observation, info["final_obs"], info["features"], info["forward_velocity"], env.states()):
        assert np.isfinite(array).all()
    _, _, _, _, info = env.step(np.zeros((4, 21), dtype=np.float32))
    assert not info["diverged"].any()
    assert env.diverged_count == 1
    assert not list(tmp_path.iterdir())


def test_resets_touch_the_ground_and_come_from_both_sides() -> None:
    model = build()
    qpos, _ = StrideStates(model).draw(np.random.default_rng(0), 256)
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        assert lowest_point(model, data) == pytest.approx(0.0, abs=1e-9)
    low, high = model.jnt_range[3:].T
    assert ((qpos[:, 3:] >= low) & (qpos[:, 3:] <= high)).all()
    env = PlanarHumanoidVectorEnv(num_envs=2000, speed=4.0, reset_speed=(0.25, 0.75))
    _, info = env.reset(seed=0)
    left_leads = info["features"][:, 1] > info["features"][:, 3]
    assert left_leads.mean() == pytest.approx(0.5, abs=0.05)
    assert np.abs(info["trunk_lean"]).max() < 0.2
    assert info["forward_velocity"].mean() == pytest.approx(2.0, abs=0.05)
    assert info["forward_velocity"].min() >= 0.999
    assert info["forward_velocity"].max() <= 3.001


def test_nothing_of_an_episode_survives_its_end() -> None:
    """A row that starts anew goes on like one that was placed in the same state."""
    env = PlanarHumanoidVectorEnv(num_envs=4, episode_steps=5)
    env.reset(seed=0)
    for action in actions(5, 4):
        env.step(action)
    other = PlanarHumanoidVectorEnv(num_envs=4)
    other.set_states(env.states())
    action = np.zeros((4, 21), dtype=np.float32)
    env.step(action)
    other.step(action)
    assert np.array_equal(env.states(), other.states())


def test_unknown_argument() -> None:
    with pytest.raises(TypeError, match="sped"):
        PlanarHumanoidVectorEnv(sped=1.0)


def test_resets_do_not_fall_at_once() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=128)
    env.reset(seed=0)
    for _ in range(7):  # almost a quarter of a second with the servos at their neutral pose
        _, _, terminated, _, _ = env.step(np.zeros((128, 21), dtype=np.float32))
        assert not terminated.any()


def test_terminations_by_hand() -> None:
    posture = np.zeros((4, 8))
    posture[:, PELVIS_HEIGHT], posture[:, HEAD_HEIGHT] = (1.0, 0.5, 1.0, 1.0), (1.6, 1.6, 0.9, 1.6)
    posture[3, TRUNK_LEAN] = -np.pi / 4
    assert task.fallen(posture, pelvis_height=0.6, head_height=1.0, lean=0.7).tolist() == [False, True, True, True]
    assert task.fallen(posture, pelvis_height=0.4, head_height=0.8, lean=0.8).tolist() == [False] * 4


def test_reward_by_hand() -> None:
    reward = task.speed_reward(np.array([4.0, 3.0, 6.0]), speed=4.0, alpha=0.5)
    assert reward == pytest.approx([1.0, np.exp(-0.5), np.exp(-1.0)])


def test_reward_of_a_posture_by_hand() -> None:
    """Upright at standing height, leaning by 0.3 rad, and 10% too low; its share counts beside that of the speed."""
    env = PlanarHumanoidVectorEnv(num_envs=3, posture_weight=0.25)
    posture = np.zeros((3, POSTURE_SIZE))
    posture[:, PELVIS_HEIGHT] = env.task.standing_height * np.array([1.0, 1.0, 0.9])
    posture[1, TRUNK_LEAN] = -0.3
    found = env.task.reward(np.array([4.0, 4.0, 3.0]), posture)
    assert found == pytest.approx([1.0, 0.75 + 0.25 * np.exp(-1), 0.75 * np.exp(-1) + 0.25 * np.exp(-1)])
    with pytest.raises(ValueError, match="posture_weight must be between 0 and 1, not 2"):
        PlanarHumanoidVectorEnv(posture_weight=2)


def test_make_vec() -> None:
    env = gym.make_vec("romgrl/PlanarHumanoid-v0", num_envs=3, vectorization_mode="vector_entry_point", speed=1.0)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (3, 358)
    assert env.observation_space.contains(observation)
    env.close()


@pytest.mark.parametrize(
    "bad",
    [
        {"num_envs": 0},
        {"num_threads": 0},
        {"speed": -1.0},
        {"alpha": 0.0},
        {"episode_steps": 0},
        {"reset_speed": (1.0, 0.5)},
        {"reset_speed": (0.0,)},
        {"fall_trunk_lean": 0.0},
        {"fall_pelvis_height": float("nan")},
        {"control_frequency": 0.0},
        {"control_frequency": 33.0, "model": build()},
    ],
)
def test_bad_arguments(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        PlanarHumanoidVectorEnv(**bad)


def test_bad_actions_and_states() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=2)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="shape"):
        env.step(np.zeros((2, 20), dtype=np.float32))
    with pytest.raises(ValueError, match="finite"):
        env.step(np.full((2, 21), np.nan, dtype=np.float32))
    with pytest.raises(ValueError, match="shape"):
        env.set_states(np.zeros((2, 24)))
