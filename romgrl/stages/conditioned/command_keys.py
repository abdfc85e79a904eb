"""Keys that ask a walker in the viewer for something else while it walks: from a key to a command, and nothing more.

MuJoCo's viewer calls back in a thread of its own; `PressedKeys` hands keys over, and all else happens in the loop that
steps the walker.
"""

from __future__ import annotations

from queue import Empty, SimpleQueue

import numpy as np

from romgrl.humanoid.command_checks import Array, Rows
from romgrl.humanoid.command_limits import AskedCommand, CommandLimits

SPEED_STEP, STYLE_STEP = 0.25, 0.1
"""What a press of an arrow changes: m/s, share of a leg's stiffness."""
UP, DOWN, LEFT, RIGHT, ENTER, RESET, FIRST_GAIT = 265, 264, 263, 262, 257, ord("R"), ord("1")
"""Codes of GLFW."""
MOST_GAITS = 9


def after_key(limits: CommandLimits, asked: AskedCommand, key: int) -> AskedCommand:
    """The command after a key; the same one where the key asks for nothing that the walker was trained for."""
    gaits = [*limits.speeds][:MOST_GAITS]
    low, high = limits.speeds[asked.gait]
    if key in (UP, DOWN):
        speed = asked.speed + (SPEED_STEP if key == UP else -SPEED_STEP)
        return asked if asked.speed == 0 and key == DOWN else asked._replace(speed=min(max(speed, low), high))
    if key in (LEFT, RIGHT):
        style = asked.style + (STYLE_STEP if key == RIGHT else -STYLE_STEP)
        return asked._replace(style=round(min(max(style, limits.styles[0]), limits.styles[1]), 6))
    if key == ENTER:
        return asked._replace(speed=0.0) if limits.stands else asked
    if 0 <= key - FIRST_GAIT < len(gaits):
        low, high = limits.speeds[gaits[key - FIRST_GAIT]]
        speed = min(max(asked.speed, low), high) if asked.speed else 0.0
        return asked._replace(gait=gaits[key - FIRST_GAIT], speed=speed)
    return asked


def keys_shown(limits: CommandLimits) -> list[tuple[str, str]]:
    """The keys that do something, and what."""
    gaits = [(str(number), gait) for number, gait in enumerate([*limits.speeds][:MOST_GAITS], start=1)]
    stands, styles = [("Enter", "stand")] if limits.stands else [], limits.styles[0] < limits.styles[1]
    return [
        ("up, down", f"{SPEED_STEP:g} m/s faster, slower"),
        *(gaits if len(gaits) > 1 else []),
        *stands,
        *([("right, left", "stiffer, softer")] if styles else []),
        ("R", "begin again"),
    ]


def shown_command(limits: CommandLimits, asked: AskedCommand) -> str:
    """The command in words, such as `run at 2.25 m/s`."""
    style = f", stiffness × {asked.style:g}" if limits.styles[0] < limits.styles[1] else ""
    return f"stand ({asked.gait}){style}" if asked.speed == 0 else f"{asked.gait} at {asked.speed:.2f} m/s{style}"


class PressedKeys:
    """What is asked of one walker now, as a schedule of its environment (`CommandSchedule`), changed by keys.

    `press` may be called in any thread; `take` and the environment belong to one.
    """

    count = 1

    def __init__(self, limits: CommandLimits, asked: AskedCommand) -> None:
        self.limits, self.asked, self.gaits = limits, asked, tuple(limits.speeds)
        self._pressed: SimpleQueue[int] = SimpleQueue()

    def press(self, key: int) -> None:
        """Keep a key until it is taken."""
        self._pressed.put(key)

    def take(self) -> bool:
        """Ask for what the keys since the last time say; whether the walker is to begin again."""
        again = False
        while True:
            try:
                key = self._pressed.get_nowait()
            except Empty:
                return again
            again |= key == RESET
            self.asked = after_key(self.limits, self.asked, key)

    def following(
        self, generator: np.random.Generator, rows: Rows, seconds: Array, before: Array | None
    ) -> tuple[Array, Array]:
        """The command of now, for one step."""
        return np.array([self.limits.columns(self.asked)] * len(rows)), np.zeros(len(rows))

    @property
    def text(self) -> str:
        """What is asked now, in words."""
        return shown_command(self.limits, self.asked)
