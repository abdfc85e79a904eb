"""Keys ask a walker for other speeds and gaits while it is watched."""

from __future__ import annotations

import threading
from functools import reduce
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco.viewer
import numpy as np
import pytest

from romgrl.config.schema import Config
from romgrl.errors import ConfigurationError
from romgrl.humanoid.command_limits import AskedCommand, CommandLimits
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import watch
from romgrl.stages.conditioned.command_keys import (
    DOWN,
    ENTER,
    LEFT,
    RIGHT,
    UP,
    PressedKeys,
    after_key,
    keys_shown,
    shown_command,
)
from romgrl.stages.wiring.humanoid import humanoid_env
from tests.helpers.configurations import with_value

LIMITS = CommandLimits({"run": (2.0, 4.1), "walk": (0.5, 2.0)}, stands=True)
STYLED = CommandLimits({"run": (2.0, 4.0)}, stands=False, styles=(0.7, 1.4))
RUN = AskedCommand(3.0, "run")
PRESSED = {
    "faster": (LIMITS, [UP, UP], AskedCommand(3.5, "run")),
    "no faster than it can": (LIMITS, [UP] * 9, AskedCommand(4.1, "run")),
    "slower": (LIMITS, [DOWN], AskedCommand(2.75, "run")),
    "no slower than it can": (LIMITS, [DOWN] * 9, AskedCommand(2.0, "run")),
    "another gait at its fastest": (LIMITS, [ord("2")], AskedCommand(2.0, "walk")),
    "and back": (LIMITS, [ord("2"), DOWN, ord("1")], AskedCommand(2.0, "run")),
    "no third gait": (LIMITS, [ord("3"), ord("0"), ord("9")], RUN),
    "standing": (LIMITS, [ENTER, DOWN], AskedCommand(0.0, "run")),
    "standing in another gait": (LIMITS, [ENTER, ord("2")], AskedCommand(0.0, "walk")),
    "from standing to the slowest": (LIMITS, [ENTER, UP], AskedCommand(2.0, "run")),
    "never trained to stand": (STYLED, [ENTER], RUN),
    "stiffer": (STYLED, [RIGHT, RIGHT], AskedCommand(3.0, "run", 1.2)),
    "softest": (STYLED, [LEFT] * 9, AskedCommand(3.0, "run", 0.7)),
    "one style": (LIMITS, [LEFT, RIGHT, RIGHT], RUN),
    "others": (LIMITS, [0, -1, 32, ord("R"), 10**6], RUN),
}


@pytest.mark.parametrize("case", PRESSED)
def test_a_key_is_a_command_within_what_was_trained(case: str) -> None:
    limits, keys, wanted = PRESSED[case]
    assert reduce(lambda asked, key: after_key(limits, asked, key), keys, RUN) == wanted


def test_what_is_shown() -> None:
    assert shown_command(LIMITS, RUN) == "run at 3.00 m/s"
    assert shown_command(LIMITS, AskedCommand(0.0, "walk")) == "stand (walk)"
    assert shown_command(STYLED, RUN) == "run at 3.00 m/s, stiffness × 1"
    assert [key for key, _ in keys_shown(LIMITS)] == ["up, down", "1", "2", "Enter", "R"]
    assert [key for key, _ in keys_shown(STYLED)] == ["up, down", "right, left", "R"]


def test_a_walker_begins_at_the_speed_in_a_gait_that_has_it() -> None:
    assert LIMITS.begun(3.0, "walk") == RUN
    assert LIMITS.begun(2.0, "walk") == AskedCommand(2.0, "walk")
    assert LIMITS.begun(2.0, "run") == AskedCommand(2.0, "run")
    assert LIMITS.begun(0.0, "walk") == AskedCommand(0.0, "walk")
    assert LIMITS.columns(AskedCommand(1.5, "walk")) == [1.5, 0.0, 1.0, 1.0]
    for limits, speed in ((LIMITS, 0.2), (LIMITS, 5.0), (STYLED, 0.0)):
        with pytest.raises(ConfigurationError, match=r"^speed: .* is not allowed; allowed: .*run 2 to 4"):
            limits.begun(speed, "run")


def test_keys_of_another_thread_are_all_taken_and_asked_from_the_next_step(
    follower: tuple[Config, dict[str, Path]],
) -> None:
    config, inputs = follower
    keys = PressedKeys(CommandLimits({"run": (2.0, 4.0), "walk": (1.0, 2.0)}, stands=True), AskedCommand(2.0, "run"))
    env = humanoid_env(config, num_envs=1, commands=keys)
    states = watch.walk_on(env, inputs["student"], 0, keys)
    next(states)
    presses = [threading.Thread(target=lambda: [keys.press(UP), keys.press(ord("9"))]) for _ in range(5)]
    for each in presses:
        each.start()
    for each in presses:
        each.join()
    next(states)
    assert keys.asked == AskedCommand(3.25, "run")
    assert env.command()[0, -4:].tolist() == [3.25, 1.0, 0.0, 1.0]
    for _ in range(30):
        place = next(states)[0][0]
    assert place > 1.0  # m: it runs
    keys.press(ord("R"))
    assert next(states)[0][0] < 0.3  # it begins again, with the same command
    assert env.command()[0, -4:].tolist() == [3.25, 1.0, 0.0, 1.0]
    env.close()


class Window:
    """A viewer of five frames, in whose third a key is pressed."""

    def __init__(self, model: Any, data: Any, key_callback: Any = None, **options: bool) -> None:
        self.cam, self.frames, self.texts, self.press = SimpleNamespace(), 0, [], key_callback

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def set_texts(self, texts: tuple[Any, Any, str, str]) -> None:
        self.texts.append(texts[3].splitlines()[0])
        assert len(texts[2].splitlines()) == len(texts[3].splitlines()) == 6

    def sync(self) -> None:
        self.frames += 1
        if self.frames == 3:
            self.press(ord("2"))

    def is_running(self) -> bool:
        return self.frames < 5


def test_the_window_shows_the_command_in_force(
    follower: tuple[Config, dict[str, Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, inputs = follower
    windows: list[Window] = []
    launch = lambda *given, **options: windows.append(Window(*given, **options)) or windows[0]  # noqa: E731
    monkeypatch.setattr(watch, "no_viewer", lambda: None)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    log = SilentLog()
    watch.run(config, inputs, tmp_path, log)
    assert windows[0].texts == ["run at 2.30 m/s", "walk at 2.00 m/s"]
    assert log.messages[0] == "asked for: run at 2.30 m/s"
    assert "up, down 0.25 m/s faster, slower, 1 run, 2 walk, Enter stand, R begin again" in log.messages[1]


def test_a_film_is_of_the_speed_that_is_asked_for(
    follower: tuple[Config, dict[str, Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, inputs = follower
    config, told = with_value(with_value(config, "watch.seconds", 0.1), "speed", 1.25), list[np.ndarray]()
    monkeypatch.setattr(watch, "no_viewer", lambda: watch.NO_DISPLAY)
    monkeypatch.setattr(watch, "film", lambda env, *_: (env.reset(seed=0), told.append(env.command()[0, -4:])))
    watch.run(config, inputs, tmp_path, SilentLog())
    assert told[0].tolist() == [1.25, 0.0, 1.0, 1.0]
    with pytest.raises(ConfigurationError, match=r"^speed: 9.0 is not allowed; allowed: 0 \(to stand\), run 2 to 4"):
        watch.run(with_value(config, "speed", 9.0), inputs, tmp_path, SilentLog())
