"""What worlds of legs with motors are asked for, and what they tell: commands, the clock, the price of work."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from romgrl.rom.drawing import draw
from romgrl.rom.env import SpringLegEnv, VariableLegEnv
from tests.helpers.rom_worlds import GRAVITY, MOTOR, Worlds, core_parameters
from tests.rom.test_variable_leg import LENGTH, MASS, drives, each_engine


@each_engine
def test_commands_are_drawn_for_each_episode_and_while_it_lasts() -> None:
    span = {"speed_low": 1.0, "speed_high": 3.0, "stiffness_share_low": 0.7, "stiffness_share_high": 1.4}
    span |= {"apex_low": 0.1, "apex_high": 0.5}
    unit = np.sqrt(GRAVITY * LENGTH)
    worlds = Worlds(core_parameters(command_steps=3, fall_height=0.0, **MOTOR | span), 100)
    worlds.batch.seed(4)
    worlds.batch.reset()
    worlds.batch.observe(worlds["observation"], worlds["features"], worlds["contact"])
    seen = [worlds["observation"][:, [18, 26, 28]].copy()]
    for _ in range(9):
        worlds.step()
        fresh = ~(worlds["terminated"] | worlds["truncated"])
        asked = worlds["final_observation"][:, 18] * unit
        expected = np.exp(-np.abs(worlds["forward_velocity"] - asked))
        np.testing.assert_allclose(worlds["reward"][fresh], expected[fresh], rtol=1e-4)
        seen.append(worlds["observation"][:, [18, 26, 28]].copy())
    changes = [bool((after != before).any()) for before, after in pairwise(seen)]
    assert changes == [False, False, True] * 3
    commands = np.concatenate(seen[::3]) * [unit, 1.0, unit]
    commands[:, 2] = commands[:, 2] ** 2 / (2 * GRAVITY)
    assert np.abs(np.corrcoef(commands.T) - np.eye(3)).max() < 0.2  # drawn apart
    for values, low, high in zip(commands.T, (1.0, 0.7, 0.1), (3.0, 1.4, 0.5), strict=True):
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high >= values.max() > high - 0.05 * (high - low)
    state = worlds.batch.save()
    worlds.step()
    first = worlds["observation"].copy()
    worlds.batch.restore(state)
    worlds.step()
    np.testing.assert_array_equal(first, worlds["observation"])


@each_engine
def test_the_time_since_the_last_touchdown() -> None:
    """It grows by a control step's, or begins within it, where the side of the touchdown changes."""
    worlds = Worlds(core_parameters(**MOTOR | {"reset_hip_angle_low": 0.3}), 64)
    worlds.batch.seed(1)
    worlds.batch.reset()
    worlds.step()
    unit, dt, ages, touchdowns = np.sqrt(LENGTH / GRAVITY), 1.0 / 30.0, 0, 0
    for _ in range(30):
        age, side = worlds["observation"][:, 27] * unit, worlds["observation"][:, 19].copy()
        worlds.step(np.zeros((64, 4), np.float32))
        seen = worlds["final_observation"]
        changed = seen[:, 19] != side
        grown = np.isclose(seen[:, 27] * unit, age + dt, atol=1e-6)
        begun = seen[:, 27] * unit < dt
        assert np.all(begun[changed])
        assert np.all(grown[~changed] | begun[~changed])
        ages += int(grown.sum())
        touchdowns += int(changed.sum())
    assert touchdowns > 30
    assert ages > 300


@each_engine
def test_the_work_of_all_actuators_can_cost() -> None:
    """Per body weight and sqrt(g L0); of the hips, too."""
    free, paid = (Worlds(core_parameters(work_cost=cost, **MOTOR)) for cost in (0.0, 0.5))
    for worlds in (free, paid):
        worlds.step(drives(1.0, 1.0, hips=1.0))
    cost = 0.5 * paid["positive_power"][0] / (MASS * GRAVITY * np.sqrt(GRAVITY * LENGTH))
    assert paid["positive_power"][0] > paid["positive_leg_motor_power"][0] > 10.0
    assert free["reward"][0] - paid["reward"][0] == pytest.approx(float(cost), rel=1e-4)


@each_engine
def test_episodes_can_begin_with_both_feet_after_a_fall() -> None:
    """Both feet rest on the ground, ahead in proportion to the speed; the trunk falls as from the drawn height."""
    ends = {"speed_low": 1.0, "speed_high": 3.0, "reset_hip_angle_low": 0.1, "reset_hip_angle_high": 0.3}
    ends |= {"reset_drop_low": 0.05, "reset_drop_high": 0.2, "reset_together": True, "reset_by_speed": True}
    worlds = Worlds(core_parameters(**MOTOR | ends), 500)
    worlds.batch.seed(2)
    worlds.batch.reset()
    worlds.batch.observe(worlds["observation"], worlds["features"], worlds["contact"])
    assert worlds["contact"].all()
    seen, unit = worlds["observation"], np.sqrt(GRAVITY * LENGTH)
    np.testing.assert_array_equal(seen[:, 10], seen[:, 11])
    angle = seen[:, 10] / seen[:, 18]  # at a speed of sqrt(g L0)
    drop = (seen[:, 3] * unit) ** 2 / (2 * GRAVITY)
    for values, low, high in ((angle, 0.1, 0.3), (drop, 0.05, 0.2)):
        assert low <= values.min() + 1e-6
        assert values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high + 1e-6
    assert (seen[:, 3] < 0).all()
    feet = worlds.feet()
    assert np.abs(feet[:, 3:5]).max() < 1e-9
    steep = Worlds(core_parameters(**MOTOR | ends | {"reset_hip_angle_high": 1.2, "speed_high": 10.0}), 200)
    steep.batch.observe(steep["observation"], steep["features"], steep["contact"])
    assert steep["observation"][:, 10].max() == pytest.approx(1.3)  # the hip's stop


def test_legs_are_drawn_with_their_motors() -> None:
    """The rod comes out of the motor as far as the rest length grows; the spring begins at its end."""
    env = VariableLegEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.array([0.0, 0.0, -1.0, 1.0], np.float32))
    worlds, image = env._worlds, env.render()
    assert image is not None
    rest = worlds.extensions(0)
    assert rest is not None
    assert rest[0] < 0 < rest[1]
    np.testing.assert_allclose(rest / worlds.parameters.leg_length, worlds._final_observation[0, 20:22], rtol=1e-6)
    features, contact = np.array([0.9, 0.0, -0.85, 0.0, -0.85]), np.array([True, True])

    def rod(extension: float) -> int:
        drawn = draw(features, contact, 0.0, worlds.parameters, np.full(2, extension))
        return int((np.abs(drawn.astype(int) - (120, 128, 140)).max(axis=2) < 8).sum())

    assert rod(0.05) > rod(0.0) > rod(-0.05) > 0
    plain = draw(features, contact, 0.0, worlds.parameters)
    assert not (np.abs(plain.astype(int) - (120, 128, 140)).max(axis=2) < 8).any()
    assert SpringLegEnv()._worlds.extensions(0) is None


def test_the_trunk_of_a_jump_stays_in_the_picture() -> None:
    """As much of it as of one that stands; the ground goes down."""
    env = VariableLegEnv()
    parameters, shown = env._worlds.parameters, []
    for height in (0.94, 1.4, 2.5):
        picture = draw([height, 0.0, -0.8, 0.0, -0.8], [False, False], 0.0, parameters)
        shown.append(int((np.abs(picture.astype(int) - (55, 65, 81)).max(axis=2) < 8).sum()))
    assert shown == pytest.approx([shown[0]] * 3, rel=0.02)
