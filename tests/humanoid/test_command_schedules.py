"""Schedules of commands: what is drawn and how often, and what tables say at which time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from romgrl.humanoid.command_schedules import CommandTable, DrawnCommands
from romgrl.humanoid.commands import CurrentCommands

DT = 1 / 30
MANY = 20_000


def drawn(schedule: DrawnCommands, before: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    return schedule.following(np.random.default_rng(0), np.arange(MANY), np.zeros(MANY), before)


def played(table: CommandTable, steps: int, count: int = 1) -> np.ndarray:
    """Commands (steps + 1, N, 2 + G) of one episode, the first one included."""
    commands, generator = CurrentCommands(table, count, DT), np.random.default_rng(0)
    commands.begin(generator, np.arange(count))
    seen = [commands.values.copy()]
    for step in range(steps):
        commands.advance(generator, np.full(count, step + 1))
        seen.append(commands.values.copy())
    return np.array(seen)


def test_first_commands_are_from_the_whole_range() -> None:
    schedule = DrawnCommands(("walk", "run", "hop"), (1.0, 4.0), styles=(0.7, 1.4), standing_share=0.05)
    commands, seconds = drawn(schedule)
    speed, weights, style = commands[:, 0], commands[:, 1:-1], commands[:, -1]
    moving = speed > 0
    assert (~moving).mean() == pytest.approx(0.05, abs=0.005)
    assert (speed[moving].min(), speed[moving].max()) == pytest.approx((1.0, 4.0), abs=0.01)
    assert speed[moving].mean() == pytest.approx(2.5, abs=0.03)
    assert set(map(tuple, weights)) == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    assert weights.mean(axis=0) == pytest.approx([1 / 3] * 3, abs=0.015)
    assert (style.min(), style.mean(), style.max()) == pytest.approx((0.7, 1.05, 1.4), abs=0.01)
    assert (seconds.min(), seconds.mean(), seconds.max()) == pytest.approx((3.0, 5.5, 8.0), abs=0.05)


def test_later_commands_are_near_but_for_a_share() -> None:
    schedule = DrawnCommands(("run",), (0.0, 5.0), step_share=0.1, near=0.5, standing_share=0.0)
    before = np.tile([2.0, 1.0, 1.0], (MANY, 1))
    off = drawn(schedule, before)[0][:, 0] - 2.0
    assert (np.abs(off) <= 0.5).mean() == pytest.approx(0.9 + 0.1 * 0.2, abs=0.01)  # a step may be a near one, too
    assert (off.min(), off.max()) == pytest.approx((-2.0, 3.0), abs=0.01)


def test_each_gait_keeps_to_its_own_range() -> None:
    schedule = DrawnCommands(
        ("walk", "run"), {"run": (2.0, 5.0), "walk": (0.5, 1.8)}, step_share=0.0, standing_share=0.0
    )
    commands, _ = drawn(schedule, np.tile([1.5, 1.0, 0.0, 1.0], (MANY, 1)))
    speed, walks = commands[:, 0], commands[:, 1] == 1
    assert (speed[walks].min(), speed[walks].max()) == pytest.approx((0.5, 1.8), abs=0.01)
    assert (speed[~walks].min(), speed[~walks].max()) == pytest.approx((2.0, 2.5), abs=0.01)
    standing = np.zeros((MANY, 4))
    away, _ = drawn(schedule, standing)  # 0 to 1 m/s is below all speeds of a run
    assert set(away[away[:, 2] == 1, 0]) == {2.0}


def test_commands_are_held_for_whole_steps() -> None:
    """A time between 3 and 6 steps is 4, 5 or 6, equally often; rows change independently of each other."""
    schedule, generator = DrawnCommands(("run",), (0.0, 5.0), hold_seconds=(0.1, 0.2)), np.random.default_rng(0)
    commands = CurrentCommands(schedule, 50, DT)
    commands.begin(generator, np.arange(50))
    speeds = [commands.speeds]
    for step in range(200):
        commands.advance(generator, np.full(50, step))
        speeds.append(commands.speeds)
    changed = np.diff(speeds, axis=0) != 0
    held = np.concatenate([np.diff(np.flatnonzero(column)) for column in changed.T])
    assert (held <= 6).mean() > 0.98  # but where a humanoid is asked to stand twice
    assert [(held == steps).mean() for steps in (4, 5, 6)] == pytest.approx([1 / 3] * 3, abs=0.04)
    assert 0.1 < changed.mean(axis=1)[6:].mean() < 0.3


def test_steps_of_a_table() -> None:
    table = CommandTable(
        ("walk", "run"), [0.0, 1.0, 2.5], [1.0, 3.0, 2.0], [[1, 0], [0, 1], [0.5, 0.5]], [1.0, 0.7, 1.4]
    )
    seen = played(table, 90)[:, 0]
    assert np.flatnonzero(np.diff(seen[:, 0])).tolist() == [29, 74]  # at 30 and 75 steps
    assert seen[[0, 29, 30, 74, 75, 90]] == pytest.approx(
        np.array([[1, 1, 0, 1]] * 2 + [[3, 0, 1, 0.7]] * 2 + [[2, 0.5, 0.5, 1.4]] * 2), abs=1e-6
    )


def test_a_change_is_not_late_by_a_rounding() -> None:
    """Rows 0.1 s apart are 3 steps apart, although sums of thirtieths are no tenths."""
    rows = np.arange(100)
    seen = played(CommandTable(("run",), 0.1 * rows, rows % 10, [1.0]), 297)[:, 0, 0]
    assert np.array_equal(seen, np.arange(298) // 3 % 10)


def test_ramps_of_a_table() -> None:
    table = CommandTable(("walk", "run"), [0.0, 2.0, 3.0], [0.5, 4.5, 4.5], [[1, 0], [0, 1], [0, 1]], ramp=True)
    seen = played(table, 120)[:, 0]
    time = np.arange(121) * DT
    assert seen[:, 0] == pytest.approx(np.minimum(0.5 + 2.0 * time, 4.5), abs=1e-6)
    assert seen[:, 2] == pytest.approx(np.minimum(time / 2.0, 1.0), abs=1e-6)
    assert seen[:, 1] + seen[:, 2] == pytest.approx(1.0, abs=1e-6)


def test_a_table_for_each_humanoid() -> None:
    table = CommandTable(("run",), [0.0, 1.0], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [1.0])
    seen = played(table, 30, count=3)
    assert table.count == 3
    assert seen[[0, 29, 30], :, 0].tolist() == [[1, 2, 3], [1, 2, 3], [4, 5, 6]]
    with pytest.raises(ValueError, match="commands must be for as many humanoids as there are, 2, not 3"):
        CurrentCommands(table, 2, DT)


def test_constant_commands() -> None:
    one = CommandTable.constant(2.0, {"walk": 0.25, "run": 0.75}, 0.9)
    assert played(one, 3, count=2) == pytest.approx(np.tile([2.0, 0.25, 0.75, 0.9], (4, 2, 1)))
    each = CommandTable.constant([1.0, 2.0], {"walk": [1.0, 0.0], "run": [0.0, 1.0]}, [0.8, 1.2])
    assert played(each, 3, count=2)[3] == pytest.approx(np.array([[1, 1, 0, 0.8], [2, 0, 1, 1.2]]))


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"gaits": ()}, "gaits must be a tuple or list of one or more"),
        ({"gaits": "run"}, "gaits must be a tuple or list of one or more"),
        ({"gaits": ("run", "run")}, "different names"),
        ({"speeds": (4.0, 1.0)}, "speeds must be a finite range from 0 to 10"),
        ({"speeds": {"walk": (1.0, 2.0)}}, "a range for each of the gaits"),
        ({"speeds": {"run": (-1.0, 2.0)}}, "speeds of run must be a finite range from 0 to 10"),
        ({"styles": (0.0, 1.0)}, "styles must be a finite range above 0 to 10"),
        ({"hold_seconds": (3.0, np.inf)}, "hold_seconds must be a finite range above 0,"),
        ({"near": -1.0}, "near must be at least 0"),
        ({"near": None}, "near must be a number"),
        ({"near": np.inf}, "near must be at least 0 and finite"),
        ({"step_share": "few"}, "step_share must be a number"),
        ({"speeds": (1.0, 1e300)}, "speeds must be a finite range from 0 to 10"),
        ({"speeds": (1.0, 10.5)}, "speeds must be a finite range from 0 to 10"),
        ({"speeds": {"run": (1.0, 1e300)}}, "speeds of run must be a finite range from 0 to 10"),
        ({"speeds": 3.0}, "speeds must be a finite range"),
        ({"speeds": "ab"}, "speeds must be a number or an array of numbers, not 'ab'"),
        ({"speeds": (1.0, 2.0, 3.0)}, "speeds must be a finite range"),
        ({"styles": (1.0, 11.0)}, "styles must be a finite range above 0 to 10"),
        ({"styles": (1e-60, 1.0)}, "styles must be a finite range above 0 to 10"),
        ({"gaits": np.array(["run"])}, "gaits must be a tuple or list"),
        ({"gaits": {"run", "walk"}}, "gaits must be a tuple or list"),
        ({"gaits": {"run": 1.0}}, "gaits must be a tuple or list"),
        ({"gaits": ("",)}, "gaits must be a tuple or list"),
        ({"gaits": (1, 2)}, "gaits must be a tuple or list"),
        ({"gaits": ([],)}, "gaits must be a tuple or list"),
        ({"gaits": ("speed",)}, "none of them speed or style"),
        ({"gaits": ("run", "style")}, "none of them speed or style"),
        ({"step_share": 1.1}, "step_share must be between 0 and 1"),
        ({"standing_share": np.nan}, "standing_share must be between 0 and 1"),
    ],
)
def test_ranges_that_are_none(bad: dict[str, Any], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        DrawnCommands(**({"gaits": ("run",), "speeds": (1.0, 4.0)} | bad))


@pytest.mark.parametrize(
    ("bad", "match"),
    [
        ({"gaits": ()}, "gaits must be a tuple or list of one or more"),
        ({"times": []}, "times must rise from 0"),
        ({"times": [0.5, 1.0]}, "times must rise from 0"),
        ({"times": [0.0, 0.0]}, "times must rise from 0"),
        ({"times": [0.0, np.inf]}, "times must rise from 0"),
        ({"speeds": [1.0, 2.0, 3.0]}, r"speeds must be for 2 times and 1 or more humanoids, not \(3,\)"),
        ({"times": [0.0]}, "speeds must be for 1 times"),
        ({"speeds": np.ones((2, 2)), "styles": np.ones((2, 3))}, "speeds, weights and styles must be for one number"),
        ({"speeds": np.ones((2, 2, 2))}, "speeds must be for 2 times"),
        ({"times": "now"}, "times must be a number or an array of numbers, not 'now'"),
        (
            {"times": np.arange(1.0, 9_000.0)},
            r"times must rise from 0, not be \[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, \.\.\.\]$",
        ),
        ({"speeds": "fast"}, "speeds must be a number or an array of numbers, not 'fast'"),
        ({"speeds": [1.0, 1e300]}, "speed must be between 0 and 10 m/s, not 1e\\+300"),
        ({"speeds": np.ones((2, 0))}, "speeds must be for 2 times and 1 or more humanoids"),
        ({"styles": [[1.0], [1.0, 2.0]]}, "styles must be a number or an array of numbers"),
        ({"styles": 11.0}, "style must be above 0 and at most 10"),
        ({"weights": {"run": 1.0}}, "weights must be a number or an array of numbers, not {'run': 1.0}"),
        ({"weights": 1.0}, "weights must have 1 columns"),
        ({"weights": [[1.0, 0.0]]}, "weights must have 1 columns"),
        ({"weights": [0.5]}, "weights of the gaits must be at least 0 and sum to 1"),
        ({"speeds": [1.0, -2.0]}, "speed must be between 0 and 10 m/s, not -2"),
        ({"styles": [1.0, np.nan]}, "style must be above 0 and at most 10, not nan"),
    ],
)
def test_tables_that_are_none(bad: dict[str, Any], match: str) -> None:
    good = {"gaits": ("run",), "times": [0.0, 1.0], "speeds": [1.0, 2.0], "weights": [1.0]}
    with pytest.raises(ValueError, match=match):
        CommandTable(**(good | bad))
