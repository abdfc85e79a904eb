"""Humanoids with commands: columns, rewards, resets, what `info` says, state, and commands that a user gives."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from romgrl.humanoid import task
from romgrl.humanoid.command_schedules import CommandTable, DrawnCommands
from romgrl.humanoid.env import PlanarHumanoidEnv
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

NAMES = ("command.speed", "command.walk", "command.run", "command.style")
DRAWN = DrawnCommands(("walk", "run"), {"walk": (0.5, 2.0), "run": (2.0, 4.0)}, (0.7, 1.4), hold_seconds=(0.1, 0.3))
NO_FALL = {"fall_pelvis_height": 0.0, "fall_head_height": 0.0, "fall_trunk_lean": 9.0}


def actions(steps: int, count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (steps, count, 21)).astype(np.float32)


def test_gymnasium_accepts_it() -> None:
    env = gym.make("romgrl/PlanarHumanoid-v0", episode_steps=20, commands=DRAWN)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # unbounded observations
        check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (362,)
    many = gym.make_vec("romgrl/PlanarHumanoid-v0", num_envs=3, vectorization_mode="vector_entry_point", commands=DRAWN)
    assert many.observation_space.contains(many.reset(seed=0)[0])


def test_columns_stand_after_those_of_the_body() -> None:
    """On the full and on the compact observation, with names; the mirror image leaves them as they are."""
    whole, compact = (PlanarHumanoidVectorEnv(num_envs=4, commands=DRAWN, compact=flag) for flag in (False, True))
    bare = PlanarHumanoidVectorEnv(num_envs=4, compact=True)
    full, info = whole.reset(seed=0)
    few, _ = compact.reset(seed=0)
    assert whole.observation_names[358:] == compact.observation_names[-4:] == NAMES
    assert compact.observation_names[:-4] == bare.observation_names
    assert np.array_equal(full[:, compact.columns], few)
    assert np.array_equal(compact.columns, whole.compact_columns)
    assert np.array_equal(full[:, 358:], info["command"])
    for env, seen in ((whole, full), (compact, few)):
        image = env.mirror_observation.image(seen)
        assert np.array_equal(image[:, -4:], seen[:, -4:])
        assert not np.array_equal(image[:, :-4], seen[:, :-4])
        assert np.array_equal(env.mirror_observation.image(image), seen)
    assert np.array_equal(bare.mirror_observation.permutation, compact.mirror_observation.permutation[:-4])
    single = PlanarHumanoidEnv(commands=DRAWN)
    assert single.observation_names == whole.observation_names
    assert np.array_equal(single.compact_columns, compact.columns)
    assert np.array_equal(single.mirror_observation.sign, whole.mirror_observation.sign)


def test_same_bits_as_the_vector_environment() -> None:
    settings: dict[str, Any] = {"commands": DRAWN, "episode_steps": 12, "alpha": None, "posture_weight": 0.1}
    single, vector = PlanarHumanoidEnv(**settings), PlanarHumanoidVectorEnv(num_envs=1, **settings)
    alone, info = single.reset(seed=3)
    together, infos = vector.reset(seed=3)
    assert np.array_equal(alone, together[0])
    assert np.array_equal(info["command"], infos["command"][0])
    ended, asked = [0, 0], set()
    for step, action in enumerate(actions(200, 1)):
        if step % 60 == 10:
            given = {"speed": 1.0 + step / 60, "gait": {"walk": 0.5, "run": 0.5}}
            assert np.array_equal(single.command(**given), vector.command(**given)[0])
        alone, reward, terminated, truncated, info = single.step(action[0])
        together, rewards, terminations, truncations, infos = vector.step(action)
        assert np.array_equal(alone, infos["final_obs"][0])
        assert (reward, terminated, truncated) == (rewards[0], terminations[0], truncations[0])
        assert np.array_equal(info["command"], infos["command"][0])
        asked.add(float(info["command"][0]))
        ended[0] += terminated
        ended[1] += truncated
        if terminated or truncated:
            alone, info = single.reset()
            assert np.array_equal(alone, together[0])
            assert np.array_equal(info["command"], infos["reset_command"][0])
    assert min(ended) > 0
    assert len(asked) > 20


def test_info_says_which_command_acted_and_which_comes_next() -> None:
    """The reward is that of the command which stood in the observation before the step."""
    env = PlanarHumanoidVectorEnv(num_envs=16, commands=DRAWN, episode_steps=20, alpha=None)
    before, _ = env.reset(seed=0)
    changes, restarts = 0, 0
    for action in actions(60, 16):
        observation, reward, terminated, truncated, info = env.step(action)
        acted, following, ended = info["command"], info["reset_command"], terminated | truncated
        assert np.array_equal(acted, before[:, 358:])
        assert np.array_equal(following, observation[:, 358:])
        assert np.array_equal(info["final_obs"][~ended], observation[~ended])
        off = np.abs(info["forward_velocity"] - acted[:, 0])
        assert reward == pytest.approx(np.exp(-4.0 / np.maximum(acted[:, 0], 0.5) * off), abs=1e-5)
        changes += int((acted != following).any(axis=1)[~ended].sum())
        restarts += int((acted[ended, 0] != following[ended, 0]).sum())
        before = observation
    assert changes > 100
    assert restarts > 20
    assert (acted.dtype, acted.shape, following.shape) == (np.float32, (16, 4), (16, 4))


def test_episodes_begin_at_a_share_of_the_speed_that_is_asked_for() -> None:
    table = CommandTable.constant(np.arange(1000) / 250, {"run": 1.0})
    env = PlanarHumanoidVectorEnv(num_envs=1000, commands=table, reset_speed=(0.5, 0.9))
    _, info = env.reset(seed=0)
    share = info["forward_velocity"][1:] / info["command"][1:, 0]
    assert info["forward_velocity"][0] == 0.0
    assert (share.min(), share.mean(), share.max()) == pytest.approx((0.5, 0.7, 0.9), abs=0.01)


def test_those_that_start_anew_have_their_own_speed() -> None:
    speeds = np.arange(16) / 4
    table = CommandTable.constant(speeds, {"run": 1.0})
    env = PlanarHumanoidVectorEnv(num_envs=16, commands=table, reset_speed=(1.0, 1.0))
    env.reset(seed=0)
    restarted = []
    for action in actions(40, 16):
        _, _, terminated, _, _ = env.step(action)
        assert np.array_equal(env.states()[terminated, 24], speeds[terminated])
        restarted.append(int(terminated.sum()))
    assert 0 < max(restarted) < 16
    assert sum(restarted) > 16


def test_a_constant_command_is_the_fixed_speed() -> None:
    """Same physics, same reward; the table draws nothing."""
    fixed = PlanarHumanoidVectorEnv(num_envs=8, speed=2.5, alpha=None)
    told = PlanarHumanoidVectorEnv(num_envs=8, commands=CommandTable.constant(2.5, {"run": 1.0}), alpha=None)
    assert np.array_equal(fixed.reset(seed=1)[0], told.reset(seed=1)[0][:, :358])
    for action in actions(40, 8):
        ours, theirs = fixed.step(action), told.step(action)
        assert np.array_equal(ours[0], theirs[0][:, :358])
        assert all(np.array_equal(a, b) for a, b in zip(ours[1:4], theirs[1:4], strict=True))
        assert set(theirs[4]) - set(ours[4]) == {"command", "reset_command"}


def test_a_table_begins_anew_with_each_episode() -> None:
    table = CommandTable(("run",), [0.0, 0.2], [1.0, 3.0], [1.0])
    env = PlanarHumanoidVectorEnv(num_envs=2, commands=table, episode_steps=10, **NO_FALL)
    env.reset(seed=0)
    steps = [env.step(action) for action in actions(20, 2)]
    assert [float(info["command"][0, 0]) for *_, info in steps] == ([1.0] * 6 + [3.0] * 4) * 2
    assert float(steps[9][4]["reset_command"][0, 0]) == 1.0
    assert float(steps[9][4]["final_obs"][0, 358]) == 3.0
    assert env.set_states(env.states())[:, 358].tolist() == [1.0, 1.0]


def test_state_brings_commands_back() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=8, commands=DRAWN, episode_steps=15)
    env.reset(seed=0)
    several = actions(60, 8)
    for action in several[:20]:
        env.step(action)
    env.command(speed=np.arange(8) / 4)
    kept = {name: (value.copy() if isinstance(value, np.ndarray) else value) for name, value in env.state().items()}
    kept["commands"] = {name: value.copy() for name, value in kept["commands"].items()}
    first = [env.step(action) for action in several[20:]]
    other = PlanarHumanoidVectorEnv(num_envs=8, commands=DRAWN, episode_steps=15)
    for again in (env, other):
        again.restore(kept)
        for ours, theirs in zip(first, [again.step(action) for action in several[20:]], strict=True):
            assert np.array_equal(ours[0], theirs[0])
            assert np.array_equal(ours[1], theirs[1])
            assert np.array_equal(ours[4]["command"], theirs[4]["command"])
    assert "commands" not in PlanarHumanoidVectorEnv().state()


def test_a_given_command_holds_to_the_end_of_the_episode() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=3, commands=DRAWN, episode_steps=15, **NO_FALL)
    first, _ = env.reset(seed=0)
    given = env.command(speed=[0.0, 1.0, 2.5], gait={"walk": [1.0, 0.5, 0.0], "run": [0.0, 0.5, 1.0]}, style=0.75)
    assert np.array_equal(given[:, :358], first[:, :358])
    expected = np.array([[0, 1, 0, 0.75], [1, 0.5, 0.5, 0.75], [2.5, 0, 1, 0.75]])
    for _ in range(15):
        _, _, _, truncated, info = env.step(np.zeros((3, 21), np.float32))
        assert np.array_equal(info["command"], expected)
    assert truncated.all()
    assert (info["reset_command"][:, 3] != 0.75).all()
    kept = env.command(gait={"run": 1.0})
    assert np.array_equal(kept[:, [358, 361]], info["reset_command"][:, [0, 3]])
    assert kept[:, 359:361].tolist() == [[0.0, 1.0]] * 3


def test_options_of_a_reset() -> None:
    env = PlanarHumanoidEnv(commands=DRAWN, reset_speed=(1.0, 1.0))
    observation, info = env.reset(seed=0, options={"speed": 2.0, "gait": {"walk": 1.0}, "style": 1.25})
    assert observation[358:].tolist() == info["command"].tolist() == [2.0, 1.0, 0.0, 1.25]
    assert info["forward_velocity"] == 2.0
    for action in actions(20, 1)[:, 0]:
        assert env.step(action)[4]["command"].tolist() == [2.0, 1.0, 0.0, 1.25]
    assert env.command(speed=0.5)[358:].tolist() == [0.5, 1.0, 0.0, 1.25]
    assert env.step(action)[4]["command"].tolist() == [0.5, 1.0, 0.0, 1.25]
    several, _ = PlanarHumanoidVectorEnv(num_envs=2, commands=DRAWN).reset(seed=0, options={"speed": [1.0, 3.0]})
    assert several[:, 358].tolist() == [1.0, 3.0]


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"sped": 1.0}, "option 'sped' is none of"),
        ({"speed": -1.0}, "speed must be between 0 and 10 m/s, not -1"),
        ({"speed": float("nan")}, "speed must be between 0 and 10 m/s, not nan"),
        ({"speed": "fast"}, "speed must be a number"),
        ({"speed": [1.0, 2.0]}, "speed must be a number"),
        ({"speed": 1e300}, "speed must be between 0 and 10 m/s, not 1e\\+300"),
        ({"speed": np.nextafter(np.float32(10), np.float32(11))}, "speed must be between 0 and 10 m/s"),
        ({"speed": "3"}, "speed must be a number or an array of numbers, not '3'"),
        ({"style": 0.0}, "style must be above 0 and at most 10"),
        ({"style": 1e-60}, "style must be above 0 and at most 10, not 1e-60"),
        ({"style": 11.0}, "style must be above 0 and at most 10"),
        ({"style": list(range(10_000))}, r"style must be a number or 1 of them, not \[0, 1, 2, 3, 4, 5, \.\.\.\]$"),
        ({"gait": "walk"}, "gait must have a weight for each name"),
        ({"gait": {"hop": 1.0}}, "gait 'hop' is none of"),
        ({"gait": {"walk": "much"}}, "gait walk must be a number"),
        ({"gait": {"walk": 0.5}}, "sum to 1"),
        ({"gait": {"walk": 1.5, "run": -0.5}}, "at least 0"),
    ],
)
def test_commands_that_are_none(bad: dict[str, Any], match: str) -> None:
    env = PlanarHumanoidEnv(commands=DRAWN)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=match):
        env.reset(options=bad)
    before = env.command()
    if "sped" not in bad:
        with pytest.raises(ValueError, match=match):
            env.command(speed=bad.get("speed", 3.0), gait=bad.get("gait"), style=bad.get("style"))
    assert np.array_equal(env.command(), before)


def test_an_environment_without_commands_takes_none() -> None:
    for env in (PlanarHumanoidEnv(), PlanarHumanoidVectorEnv(num_envs=2)):
        with pytest.raises(ValueError, match="made without commands"):
            env.reset(options={"speed": 2.0})
        _, info = env.reset(seed=0, options={})
        assert "command" not in info
        with pytest.raises(ValueError, match="made without commands"):
            env.command(speed=2.0)


def test_sensitivity_by_hand() -> None:
    assert task.relative_sensitivity(np.array([0.0, 0.25, 0.5, 1.0, 4.0])).tolist() == [8.0, 8.0, 8.0, 4.0, 1.0]
    assert (task.sensitivity(None, 2.0), task.sensitivity(2.5, 2.0)) == (2.0, 2.5)
    found = task.SpeedTask.of(PlanarHumanoidEnv().model, speed=2.0, alpha=None).reward(
        np.array([1.5]), np.zeros((1, 10))
    )
    assert found == pytest.approx([np.exp(-1.0)])
