"""What run_policy.py asks a walker that follows commands for: speeds, gaits and a style, and when.

Reads the section `command` of policy.json, which says what the policy was trained for, and needs numpy alone. A command
(2 + G,) is a speed, m/s, a weight for each of G gaits, one of which is 1, and a style, the share of a leg's stiffness.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

COMMANDS_FORM = "TIME:SPEED or TIME:SPEED:GAIT, ... with times that rise from 0 s, such as 0:2,5:3.5"
LATE_SECONDS = 1e-6  # s by which a change may seem to be late and is not


class Timed(NamedTuple):
    """A command from a time on: s, m/s, name of the gait."""

    time: float
    speed: float
    gait: str


class TimedCommands:
    """Commands over the time of a walk; each is held, or with `ramp` the speed goes straight on to the next one."""

    def __init__(self, rows: list[Timed], gaits: list[str], style: float, *, ramp: bool) -> None:
        self.rows, self.ramp = rows, ramp
        self.times = np.array([row.time for row in rows])
        weights = [[float(gait == row.gait) for gait in gaits] for row in rows]
        self.commands = np.array([[row.speed, *of, style] for row, of in zip(rows, weights, strict=True)])

    def at(self, seconds: float) -> NDArray[np.float32]:
        """The command (2 + G,) of a time."""
        row = int(np.searchsorted(self.times, seconds + LATE_SECONDS, side="right")) - 1
        now = self.commands[row].copy()
        if self.ramp and row + 1 < len(self.times):
            share = (seconds - self.times[row]) / (self.times[row + 1] - self.times[row])
            now += min(max(share, 0.0), 1.0) * (self.commands[row + 1] - now)
        command: NDArray[np.float32] = now.astype(np.float32)
        return command


class FollowingPolicy:
    """A policy with the command of each control step, at a rate, Hz; `asked`: the speeds so far, m/s."""

    def __init__(self, policy: Any, commands: TimedCommands, rate: float) -> None:
        self.policy, self.commands, self.rate = policy, commands, rate
        self.asked: list[float] = []

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float64]:
        self.policy.command[:] = self.commands.at(len(self.asked) / self.rate)
        self.asked.append(float(self.policy.command[0]))
        control: NDArray[np.float64] = self.policy(observation)
        return control


def add_options(parser: argparse.ArgumentParser) -> None:
    """What a walk may be asked for."""
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument("--speed", type=float, help="m/s, 0: to stand (default: that of policy.json)")
    asked.add_argument("--commands", metavar="LIST", help=f"one after the other: {COMMANDS_FORM}")
    told = "straight from one speed of --commands to the next; alone: from the slowest to the fastest and back"
    parser.add_argument("--ramp", action="store_true", help=told)
    parser.add_argument("--gait", help="one of those of policy.json (default: one that has the speed)")
    parser.add_argument("--style", type=float, help="share of the leg's stiffness (default: that of policy.json)")


def follow_options(
    policy: Any, description: dict[str, Any], parser: argparse.ArgumentParser
) -> tuple[Any, list[float]]:
    """The policy with the commands that the options of the parser ask for, and the speeds as they come, m/s.

    Ends the process for options that are not allowed.
    """
    options = parser.parse_args()
    try:
        commands = read_commands(options, description["command"], options.seconds)
    except ValueError as error:
        parser.error(str(error))
    following = FollowingPolicy(policy, commands, description["control"]["rate"])
    return following, following.asked


def read_commands(options: argparse.Namespace, section: dict[str, Any], seconds: float) -> TimedCommands:
    """What the options ask for in a walk of so many seconds. ValueError for what the policy was not trained for."""
    speeds = section["gaits"]
    begin, (low, high) = section["begin"], section["style"]
    style = begin["style"] if options.style is None else options.style
    if not low <= style <= high:
        raise ValueError(refused("--style", style, f"{low:g}" if low == high else f"{low:g} to {high:g}"))
    if options.gait is not None and options.gait not in speeds:
        raise ValueError(refused("--gait", options.gait, ", ".join(speeds)))
    if options.ramp and options.speed is not None:
        raise ValueError("argument --ramp: not allowed with argument --speed")

    def gait_of(speed: float, option: str, gait: str | None, before: str) -> str:
        return gait_with(speed, option, gait or options.gait, before, speeds, stands=section["standing"]["trained"])

    if options.commands is not None:
        rows = timed_rows(options.commands, begin["gait"], gait_of)
    elif options.ramp:
        gait = options.gait or begin["gait"]
        ends = (*speeds[gait], speeds[gait][0])
        rows = [Timed(share * seconds, speed, gait) for share, speed in zip((0.0, 0.5, 1.0), ends, strict=True)]
    else:
        speed = options.speed
        if speed is None and begin["gait"] == (options.gait or begin["gait"]):
            speed = begin["speed"]
        elif speed is None:
            speed = min(max(begin["speed"], speeds[options.gait][0]), speeds[options.gait][1])
        rows = [Timed(0.0, speed, gait_of(speed, "--speed", None, begin["gait"]))]
    if options.ramp and (len({row.gait for row in rows}) > 1 or not all(row.speed for row in rows)):
        raise ValueError(refused("--commands", options.commands, "with --ramp one gait, and no standing"))
    return TimedCommands(rows, [*speeds], style, ramp=options.ramp)


def timed_rows(text: str, gait: str, gait_of: Callable[[float, str, str | None, str], str]) -> list[Timed]:
    """The rows of `--commands`; a gait goes on where it has the next speed."""
    rows: list[Timed] = []
    for part in text.split(","):
        time, _, rest = part.partition(":")
        speed, _, named = rest.partition(":")
        try:
            numbers = float(time), float(speed)
        except ValueError:
            raise ValueError(refused("--commands", part, COMMANDS_FORM)) from None
        if not (numbers[0] == 0.0 if not rows else rows[-1].time < numbers[0] < 1e9):
            raise ValueError(refused("--commands", part, COMMANDS_FORM))
        gait = gait_of(numbers[1], "--commands", named or None, gait)
        rows.append(Timed(*numbers, gait))
    return rows


def gait_with(
    speed: float, option: str, gait: str | None, before: str, speeds: dict[str, list[float]], *, stands: bool
) -> str:
    """A gait that has a speed, m/s: the one that is named, else the one before, else the first. ValueError."""
    if gait is not None and gait not in speeds:
        raise ValueError(refused(option, gait, ", ".join(speeds)))
    for name in [gait] if gait is not None else [before, *speeds]:
        low, high = speeds[name]
        if (speed == 0 and stands) or low - LATE_SECONDS <= speed <= high + LATE_SECONDS:
            return name
    told = [f"{name} {low:g} to {high:g} m/s" for name, (low, high) in speeds.items() if gait in (None, name)]
    raise ValueError(refused(option, speed, ", ".join([*(["0 (to stand)"] if stands else []), *told])))


def refused(option: str, value: object, permitted: str) -> str:
    """The line for a bad option."""
    return f"{option}: {' '.join(str(value).split())[:60]} is not allowed; allowed: {permitted}"
