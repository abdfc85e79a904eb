"""Strides of the reduced-order model by single substeps: the same motion, the right section, the right coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from romgrl.rom.gait_clocks import HOP, RUN
from romgrl.rom.parameters import SpringLegParameters, VariableLegParameters
from romgrl.rom.phase_policy import PhasePolicy
from romgrl.rom.return_map import StrideMap
from romgrl.rom.vector_env import SpringLegVectorEnv
from tests.helpers.rom_worlds import WALKER
from tests.helpers.scissors import scissors

SUBSTEPS, WORLDS = 16, 24


def strides(**changed: object) -> StrideMap:
    values = {"engine": "native", **changed}
    return StrideMap(scissors, SpringLegParameters(**values), speed=4.0, control_frequency=30.0)


@pytest.mark.parametrize("engine", ["native", "box2d"])
def test_substeps_make_the_motion_of_the_environment_bit_for_bit(engine: str) -> None:
    stride = strides(engine=engine)
    end = stride.settled(WORLDS, strides=1, seed=3)
    crossed = np.isfinite(end.time)
    assert crossed.sum() > WORLDS / 2
    env = SpringLegVectorEnv(
        parameters=SpringLegParameters(engine=engine),
        num_envs=WORLDS,
        speed=4.0,
        episode_steps=10**6,
    )
    observation, _ = env.reset(seed=3)
    substeps = np.where(crossed, np.ceil(np.nan_to_num(end.time) * stride.frequency - 1e-9), 0).astype(int)
    states, actions = env.save(), np.zeros((WORLDS, 2), np.float32)
    for step in range(substeps.max() // SUBSTEPS + 1):
        there = substeps // SUBSTEPS == step
        action = scissors(observation)
        states[there], actions[there] = env.save()[there], action[there]
        observation = env.step(action)[0]
    fine = stride._worlds(WORLDS)  # the rest of the last control step
    fine.restore(states)
    for rest in range(SUBSTEPS):
        there = crossed & (substeps % SUBSTEPS == rest)
        actions_kept = 0 if rest == 0 else 2  # the last action is in the state from the first substep on
        moved = slice(0, WALKER.stop + actions_kept)
        np.testing.assert_array_equal(end.walkers.states[there, moved], fine.save()[there, moved])
        fine.step(actions)


def test_every_crossing_is_on_the_section_and_a_stride_is_one_after_the_other() -> None:
    stride = strides()
    start = stride.settled(WORLDS, strides=1, seed=0)
    two, one = stride.settled(WORLDS, strides=2, seed=0), stride.walk(start.walkers)
    both = np.isfinite(start.time) & np.isfinite(two.time)
    assert both.sum() > 5
    np.testing.assert_array_equal(two.coordinates[both], one.coordinates[both])
    before_crossing = (start.time * stride.frequency) % 1.0 > 1e-12  # the walkers are at the end of that substep
    late = np.where(before_crossing, 1 - (start.time * stride.frequency) % 1.0, 0) / stride.frequency
    np.testing.assert_allclose((start.time + late + one.time)[both], two.time[both], atol=1e-9)
    # at the end of the substep the left foot is ahead by less than it moves in one
    motion, gap = stride._motion(start.walkers.states[both])
    assert ((gap >= 0) & (gap < 15.0 / stride.frequency)).all()
    np.testing.assert_allclose(motion[:, 1], start.coordinates[both][:, 1], atol=0.01)
    assert stride.scales.shape == (len(stride.names),) == (start.coordinates.shape[1],)


@pytest.mark.parametrize("locked", [True, False])
def test_a_disturbance_moves_each_coordinate_by_itself(locked: bool) -> None:
    stride = strides(trunk_locked=locked)
    walkers = stride.settled(WORLDS, strides=1, seed=0).walkers
    offsets = 0.01 * np.random.default_rng(0).standard_normal((WORLDS, len(stride.names)))
    (before, gap), (after, other) = (
        stride._motion(each.states) for each in (walkers, stride.disturbed(walkers, offsets))
    )
    np.testing.assert_allclose(after - before, offsets, atol=1e-12)
    np.testing.assert_array_equal(gap, other)
    assert ("pitch" in stride.names) is not locked
    again = stride.walk(stride.disturbed(walkers, 0 * offsets))
    np.testing.assert_array_equal(again.coordinates, stride.walk(walkers).coordinates)


def test_legs_with_motors_have_a_clock_and_no_shortening() -> None:
    """A disturbance moves each coordinate by itself, a drive beyond what a policy asks for, too."""
    stride = StrideMap(PhasePolicy(RUN.mean), VariableLegParameters(engine="native"), speed=4.0, control_frequency=30.0)
    names = stride.names
    assert {"touchdown_age", "left_extension", "right_extension_rate", "left_drive"} <= set(names)
    assert not any("shortening" in name for name in names)
    assert any("shortening" in name for name in strides().names)
    assert len(stride.scales) == len(names)
    end = stride.settled(64, strides=1, seed=3)
    crossed = np.isfinite(end.time)
    assert crossed.sum() > 8
    walkers, before = end.walkers.rows(crossed), end.coordinates[crossed]
    plain, _ = stride._motion(walkers.states)
    assert before.shape[1] == len(names)
    for index in range(len(names)):
        offsets = np.zeros_like(before)
        offsets[:, index] = 0.03
        moved, _ = stride._motion(stride.disturbed(walkers, offsets).states)
        np.testing.assert_allclose((moved - plain)[:, index], 0.03, atol=1e-12)
    offsets = np.zeros_like(before)
    offsets[:, names.index("left_drive")] = 0.5
    assert stride.walk(stride.disturbed(walkers, offsets)).coordinates.shape == before.shape


def test_a_hop_is_cut_at_the_top_of_its_flight() -> None:
    """The trunk neither rises nor falls there; a disturbance moves each coordinate by itself."""
    parameters = VariableLegParameters(
        engine="native",
        reset_together=True,
        reset_by_speed=True,
        reset_hip_angle=(0.1, 0.3),
        reset_drop=(0.05, 0.1),
        stiffness=10500.0,
    )
    stride = StrideMap(PhasePolicy(HOP.mean, "hop"), parameters, speed=0.5, control_frequency=30.0, top=True)
    names = stride.names
    assert "trunk_vy" not in names
    end = stride.settled(32, strides=1, seed=1)
    crossed = np.isfinite(end.time)
    assert crossed.sum() > 8
    walkers, before = end.walkers.rows(crossed), end.coordinates[crossed]
    fall = -walkers.states[:, 4]
    assert ((fall >= 0) & (fall < 9.81 / stride.frequency)).all()
    plain, _ = stride._motion(walkers.states)
    for index in range(len(names)):
        offsets = np.zeros_like(before)
        offsets[:, index] = 0.02
        moved, _ = stride._motion(stride.disturbed(walkers, offsets).states)
        np.testing.assert_allclose(moved - plain, offsets, atol=1e-12)


def test_who_falls_has_no_crossing() -> None:
    limp = StrideMap(
        lambda observation: np.zeros((len(observation), 2), np.float32),
        SpringLegParameters(engine="native"),
        speed=4.0,
        control_frequency=30.0,
    )
    end = limp.settled(8, strides=3, seed=0)
    assert np.isnan(end.time).all()
    assert np.isnan(end.coordinates).all()
