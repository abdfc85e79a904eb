"""What is refused of commands: by a reset, before it, by `restore`, and of schedules; and that nothing changes then."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from romgrl.humanoid.command_schedules import CommandTable, DrawnCommands
from romgrl.humanoid.commands import CurrentCommands
from romgrl.humanoid.env import PlanarHumanoidEnv
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

DRAWN = DrawnCommands(("walk", "run"), (0.5, 4.0), hold_seconds=(0.1, 0.3))
DT = 1 / 30
Humanoids = PlanarHumanoidEnv | PlanarHumanoidVectorEnv
Maker = Callable[..., Humanoids]
MAKERS = (PlanarHumanoidEnv, PlanarHumanoidVectorEnv)


def still(env: Humanoids) -> np.ndarray:
    return np.zeros(env.action_space.shape or (), np.float32)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"speed": -1.0}, "speed must be between"),
        ({"speed": 2.0, "gait": {"walk": 0.5}}, "sum to 1"),
        ({"sped": 1.0}, "option 'sped' is none of"),
        ({3: 1.0}, "option 3 is none of"),
        ([("speed", 1.0)], "options must be a mapping"),
        ("speed", "options must be a mapping"),
        (2.0, "options must be a mapping"),
    ],
)
def test_a_refused_reset_changes_nothing(make: Maker, options: Any, match: str) -> None:
    env, same = make(commands=DRAWN), make(commands=DRAWN)
    for each in (env, same):
        each.reset(seed=0)
        each.step(still(each))
    before, stream = env._commands.values.copy(), env._generator.bit_generator.state
    with pytest.raises(ValueError, match=match):
        env.reset(seed=1, options=options)
    assert np.array_equal(env._commands.values, before)
    assert env._generator.bit_generator.state == stream
    for _ in range(12):
        assert np.array_equal(env.step(still(env))[0], same.step(still(same))[0])
    assert np.array_equal(env.reset()[0], same.reset()[0])


@pytest.mark.parametrize("make", MAKERS)
def test_nothing_is_asked_before_the_first_reset(make: Maker) -> None:
    env = make(commands=DRAWN)
    for asked in ({}, {"speed": 1.0}):
        with pytest.raises(ValueError, match=r"^reset first"):
            env.command(**asked)
    with pytest.raises(ValueError, match=r"^reset first"):
        env.step(still(env))
    env.reset(seed=0)
    env.command(speed=1.0)
    env.step(still(env))
    bare = make()
    bare.step(still(bare))


def test_states_begin_commands_too() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=2, commands=DRAWN)
    env.set_states(env.states())
    env.step(still(env))


@pytest.mark.parametrize("make", MAKERS)
def test_asking_for_nothing_lets_the_schedule_go_on(make: Maker) -> None:
    env, same = make(commands=DRAWN, fall_pelvis_height=0.0), make(commands=DRAWN, fall_pelvis_height=0.0)
    present, _ = env.reset(seed=0, options={"speed": None})
    same.reset(seed=0)
    seen = set()
    for _ in range(20):
        assert np.array_equal(env.command(), present)
        present, *_, info = env.step(still(env))
        assert np.array_equal(info["command"], same.step(still(same))[-1]["command"])
        seen.add(float(info["command"].flat[0]))
    assert len(seen) > 1


def copied(state: dict[str, Any]) -> dict[str, Any]:
    return {name: copied(value) if isinstance(value, dict) else np.copy(value) for name, value in state.items()}


def of_three(**settings: Any) -> dict[str, Any]:
    env = PlanarHumanoidVectorEnv(**({"num_envs": 3} | settings))
    env.reset(seed=5)
    return env.state()


def changed(**values: Any) -> dict[str, Any]:
    state = of_three(commands=DRAWN)
    return state | {"commands": state["commands"] | values}


@pytest.mark.parametrize(
    ("make_state", "match"),
    [
        (lambda: of_three(commands=CommandTable.constant(1.0, {"hop": 1.0, "run": 0.0})), "the commands .*walk.*not"),
        (lambda: of_three(commands=CommandTable.constant(1.0, {"run": 1.0})), "must have the commands"),
        (of_three, "state must have commands with"),
        (lambda: of_three(commands=DRAWN, num_envs=1), "state must have states of shape"),
        (lambda: changed(values=np.full((3, 4), np.nan)), "speed must be between"),
        (lambda: changed(values=np.zeros((3, 4))), "style must be above 0"),
        (lambda: changed(values=np.array([[1.0, 1.0, 0.0, 1.0]])), "state must have commands of shape"),
        (lambda: changed(left=np.full(3, -1)), "left of the state's commands"),
        (lambda: changed(left=np.full(3, np.nan)), "left of the state's commands"),
        (lambda: changed(left=None), "left of the state's commands must be a number"),
        (lambda: of_three(commands=DRAWN) | {"commands": [1.0]}, "state must have commands with"),
        (lambda: of_three(commands=DRAWN) | {"generator": {"state": 1}}, "generator"),
        (lambda: of_three(commands=DRAWN) | {"elapsed": np.zeros(1)}, "elapsed"),
    ],
)
def test_a_state_of_other_humanoids_is_refused(make_state: Callable[[], dict[str, Any]], match: str) -> None:
    env = PlanarHumanoidVectorEnv(num_envs=3, commands=DRAWN)
    env.reset(seed=0)
    before = copied(env.state())
    with pytest.raises(ValueError, match=match):
        env.restore(make_state())
    after = copied(env.state())
    assert repr(before) == repr(after)
    assert np.array_equal(before["states"], after["states"])


def test_states_that_fit() -> None:
    """With commands into without is none of them; one from before the first reset is."""
    with pytest.raises(ValueError, match="state must have no commands"):
        PlanarHumanoidVectorEnv(num_envs=3).restore(of_three(commands=DRAWN))
    env, fresh = (PlanarHumanoidVectorEnv(num_envs=3, commands=DRAWN) for _ in range(2))
    env.reset(seed=0)
    env.restore(fresh.state())
    with pytest.raises(ValueError, match=r"^reset first"):
        env.step(still(env))


class Own:
    """A schedule of a user's own that asks one humanoid for what it is told."""

    gaits, count = ("run",), None

    def __init__(self, commands: Any, seconds: Any) -> None:
        self.asked = commands, seconds

    def following(self, *_: Any) -> Any:
        return self.asked


@pytest.mark.parametrize(
    ("commands", "seconds", "match"),
    [
        ([[np.nan, 1.0, 1.0]], [1.0], "speed must be between"),
        ([[-1.0, 1.0, 1.0]], [1.0], "speed must be between"),
        ([[1.0, 2.0, 1.0]], [1.0], "sum to 1"),
        ([[1.0]], [1.0], "commands and seconds of the schedule must have shapes"),
        ([[1.0, 1.0, 1.0]], [[1.0]], "commands and seconds of the schedule must have shapes"),
        ([[1.0, 1.0, 1.0]], [np.nan], "seconds of the schedule must be at least 0, not nan"),
        ([[1.0, 1.0, 1.0]], [-1.0], "seconds of the schedule must be at least 0, not -1"),
        ("fast", [1.0], "commands of the schedule must be a number"),
    ],
)
def test_a_schedule_of_ones_own_is_checked(commands: Any, seconds: Any, match: str) -> None:
    current, generator = CurrentCommands(Own(commands, seconds), 1, DT), np.random.default_rng(0)
    with pytest.raises(ValueError, match=match):
        current.begin(generator, np.arange(1))
    schedule = Own([[1.0, 1.0, 1.0]], [0.0])
    later = CurrentCommands(schedule, 1, DT)
    later.begin(generator, np.arange(1))
    schedule.asked = commands, seconds
    with pytest.raises(ValueError, match=match):
        later.advance(generator, np.ones(1, np.int64))
    assert later.values.tolist() == [[1.0, 1.0, 1.0]]


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("commands", ["walk", {"walk": 1.0}, 3.0, DrawnCommands, CommandTable, ()])
def test_what_is_no_schedule(make: Maker, commands: Any) -> None:
    with pytest.raises(ValueError, match=r"^commands must be a schedule, such as a CommandTable"):
        make(commands=commands)


def test_a_schedule_for_others() -> None:
    three = CommandTable.constant([1.0, 2.0, 3.0], {"run": 1.0})
    with pytest.raises(ValueError, match=r"^commands must be for as many humanoids as there are, 1, not 3$"):
        PlanarHumanoidEnv(commands=three)
    with pytest.raises(ValueError, match=r"^gaits must be a tuple or list"):
        CurrentCommands(type("Sets", (Own,), {"gaits": {"run"}})(None, None), 1, DT)


@pytest.mark.parametrize(
    ("speed", "gait", "match"),
    [
        (1, "walk", "gait must have a weight for each name"),
        (1, {"walk": "much"}, "gait walk must be a number"),
        (1, {}, "gaits must be"),
        (1, {"walk": [1.0, 0.0], "run": [0.0, 1.0, 1.0]}, "gait must have as many weights for each name"),
        ("fast", {"walk": 1.0}, "speed must be a number"),
        ([[1.0], [2.0]], {"walk": 1.0}, "speed must be a number or one for each humanoid"),
        ([], {"walk": 1.0}, "speed must be a number or one for each humanoid"),
    ],
)
def test_constant_commands_that_are_none(speed: Any, gait: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        CommandTable.constant(speed, gait)


def test_schedules_keep_what_they_checked() -> None:
    """Whatever becomes of the lists and mappings that they were made of."""
    gaits, speeds, styles, row = ["walk", "run"], {"walk": [1.0, 1.0], "run": [1.0, 1.0]}, [1.0, 1.0], [1.0]
    schedule = DrawnCommands(gaits, speeds, styles, standing_share=0.0)
    table = CommandTable(gaits, [0.0], row, [0.0, 1.0])
    gaits.append("hop")
    speeds["walk"], speeds["run"][0], styles[1], row[0] = [-1.0, 1e300], -3.0, 1e9, -4.0
    for each in (schedule, table):
        commands, _ = each.following(np.random.default_rng(0), np.arange(50), np.zeros(50), None)
        assert commands.shape == (50, 4)
        assert set(commands[:, [0, 3]].flat) == {1.0}
