"""A share of the episodes begins in states of a bank: drawn by the worlds themselves, with their commands."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.rom import _core
from tests.helpers.rom_worlds import MOTOR, Worlds, core_parameters
from tests.rom.test_variable_leg import each_engine

pytestmark = each_engine

Rows = NDArray[np.float64]
ROWS = 90
ACTION = slice(_core.WALKER_SIZE, _core.WALKER_SIZE + 4)
SPEED, STEPS, NUMBER = (_core.WALKER_SIZE + 4 + i for i in range(3))
STREAM = slice(_core.WALKER_SIZE + 7, _core.WALKER_SIZE + 10)  # seed in two parts, world
SHARE, ORIGIN, TOUCHDOWN = 22, 19, 20  # of the stiffness; x, m
COMMANDS = {"speed_low": 1.0, "speed_high": 3.0, "stiffness_share_low": 0.7, "stiffness_share_high": 1.4}


def legs(**values: object) -> _core.Parameters:
    return core_parameters(**MOTOR | COMMANDS | values)


def bank() -> Rows:
    """States in the middle of a movement, some metres from where it began, each with another command."""
    worlds = Worlds(legs(fall_height=0.0), ROWS)
    worlds.batch.seed(11)
    worlds.batch.reset()
    shake(worlds, 30, seed=1)
    states = worlds.batch.save()
    states[:, [ORIGIN, TOUCHDOWN]] += 8.0
    return states


def shake(worlds: Worlds, steps: int, seed: int) -> NDArray[np.float32]:
    """Step with random actions; what was observed (steps, N, O)."""
    draw, seen = np.random.default_rng(seed), []
    for _ in range(steps):
        worlds.step(draw.uniform(-1, 1, (worlds.batch.num_worlds, 4)).astype(np.float32))
        seen.append(worlds["observation"].copy())
    return np.array(seen)


def fresh(share: float | None, count: int = 300, threads: int = 1, seed: int = 5, **values: object) -> Worlds:
    """Worlds at the start of an episode, with the bank unless the share is None."""
    worlds = Worlds(legs(**values), count, threads)
    if share is not None:
        worlds.batch.begin_in(bank(), share)
    worlds.batch.seed(seed)
    worlds.batch.reset()
    return worlds


def drawn_rows(states: Rows, rows: Rows) -> NDArray[np.int64]:
    """The row of the bank that each world is in but for its place; -1: none."""
    trunk = slice(1, 18)
    same = (states[:, None, trunk] == rows[None, :, trunk]).all(axis=2)
    return np.where(same.any(axis=1), same.argmax(axis=1), -1)


def test_the_share_is_kept_and_states_have_their_commands() -> None:
    rows = bank()
    states = fresh(0.3, 2000).batch.save()
    found = drawn_rows(states, rows)
    taken = found >= 0
    assert 0.26 < taken.mean() < 0.34
    assert len(np.unique(found[taken])) == ROWS
    assert np.bincount(found[taken]).max() < 30  # of 600
    of = rows[found[taken]]
    for column in (SPEED, SHARE, 21, 23):  # the side of the last touchdown, and the time since
        np.testing.assert_array_equal(states[taken, column], of[:, column])
    np.testing.assert_array_equal(states[taken, ACTION], of[:, ACTION])
    np.testing.assert_array_equal(states[taken, 24 : _core.WALKER_SIZE], of[:, 24 : _core.WALKER_SIZE])
    assert (states[taken, ORIGIN] == 0).all()
    np.testing.assert_allclose(states[taken, TOUCHDOWN], of[:, TOUCHDOWN] - of[:, ORIGIN], atol=1e-12)
    assert (states[:, STEPS] == 0).all()
    assert (states[:, NUMBER] == 1).all()
    ordinary = fresh(None, 2000).batch.save()
    np.testing.assert_array_equal(states[:, STREAM], ordinary[:, STREAM])
    np.testing.assert_array_equal(states[~taken], ordinary[~taken])


def test_no_share_changes_no_bit_and_the_whole_share_leaves_no_other_start() -> None:
    plain, none = fresh(None, episode_steps=7), fresh(0.0, episode_steps=7)
    np.testing.assert_array_equal(shake(plain, 30, seed=2), shake(none, 30, seed=2))
    assert plain.batch.save().tobytes() == none.batch.save().tobytes()
    assert (drawn_rows(fresh(1.0).batch.save(), bank()) >= 0).all()


def test_worlds_that_end_in_a_step_begin_in_the_bank_and_go_on_from_there() -> None:
    """As the world of the bank went on: the same observation, but for what rounds where it stood further away."""
    rows, worlds = bank(), fresh(1.0, 64, episode_steps=5, fall_height=0.0)
    shake(worlds, 5, seed=3)
    assert (worlds["terminated"] | worlds["truncated"]).all()
    states = worlds.batch.save()
    found = drawn_rows(states, rows)
    assert (found >= 0).all()
    assert (states[:, STEPS] == 0).all()
    original = Worlds(legs(fall_height=0.0), 64)
    original.batch.restore(np.ascontiguousarray(rows[found]))
    original.batch.observe(original["observation"], original["features"], original["contact"])
    np.testing.assert_allclose(worlds["observation"], original["observation"], atol=1e-6)
    np.testing.assert_array_equal(worlds["reset_features"], original["features"])
    assert not np.array_equal(worlds["observation"], worlds["final_observation"])
    for each in (worlds, original):
        shake(each, 3, seed=4)
    np.testing.assert_allclose(worlds["observation"], original["observation"], atol=1e-5)


def test_threads_change_no_bit_and_a_seed_gives_the_same_again() -> None:
    one = shake(fresh(0.5, 37, episode_steps=6), 40, seed=6)
    np.testing.assert_array_equal(one, shake(fresh(0.5, 37, threads=3, episode_steps=6), 40, seed=6))
    assert not np.array_equal(one, shake(fresh(0.5, 37, seed=6, episode_steps=6), 40, seed=6))


def test_restored_worlds_draw_what_they_would_have_drawn() -> None:
    worlds = fresh(0.5, 37, episode_steps=6)
    shake(worlds, 9, seed=7)
    states = worlds.batch.save()
    onwards = shake(worlds, 20, seed=8)
    other = fresh(0.5, 37, seed=99, episode_steps=6)
    other.batch.restore(states)
    np.testing.assert_array_equal(onwards, shake(other, 20, seed=8))
    without = fresh(None, 37, episode_steps=6)
    without.batch.restore(states)
    assert not np.array_equal(onwards, shake(without, 20, seed=8))


def test_commands_still_change_within_an_episode() -> None:
    worlds = fresh(1.0, 50, command_steps=3, fall_height=0.0)
    speeds = [worlds.batch.save()[:, SPEED]]
    for _ in range(4):
        shake(worlds, 1, seed=9)
        speeds.append(worlds.batch.save()[:, SPEED])
    changed = [bool((after != before).all()) for before, after in pairwise(speeds)]
    assert changed == [False, False, True, False]


def test_what_is_no_bank_is_refused_and_changes_nothing() -> None:
    worlds, rows = fresh(0.5, 37), bank()
    broken = rows.copy()
    broken[3, 1] = np.nan
    for states, share, line in (
        (broken, 0.5, "not a saved state"),
        (rows[:0], 0.5, "a state at least"),
        (rows, 1.5, "the share of a bank must be 0 to 1"),
        (rows, float("nan"), "the share of a bank must be 0 to 1"),
        (rows[:, :-1].copy(), 0.5, "states must be an aligned"),
        (rows[0].copy(), 0.5, "states must be an aligned"),
        (rows.astype(np.float32), 0.5, "dtype float64"),
    ):
        with pytest.raises(ValueError, match=line):
            worlds.batch.begin_in(states, share)
    worlds.batch.seed(5)
    worlds.batch.reset()
    np.testing.assert_array_equal(worlds.batch.save(), fresh(0.5, 37).batch.save())
