"""What humanoids are asked for while they run: the commands of now, their columns, and how a user gives others."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romgrl.humanoid.command_checks import (
    ROUNDING,
    SPEED,
    STYLE,
    WEIGHTS,
    Array,
    Rows,
    check_commands,
    check_gaits,
    check_weights_by_name,
    numbers,
    numbers_of_each,
    shown,
)
from romgrl.humanoid.command_schedules import CommandSchedule

Float32 = NDArray[np.float32]

_FOREVER = 10**15
"""Control steps that no episode has."""
_OPTIONS = ("speed", "gait", "style")
Given = Sequence[tuple[int | slice, Array]]
"""Columns of commands, and what to write there (N,) or (N, columns)."""


class CurrentCommands:
    """The command of each of N humanoids; without a schedule there are none, and nothing is drawn or observed.

    Args:
        schedule: what is asked, and when; ValueError for what is none.
        num_envs: humanoids; ValueError where the schedule is for another number.
        control_step: duration of a control step, s.
    """

    def __init__(self, schedule: CommandSchedule | None, num_envs: int, control_step: float) -> None:
        needed = ("gaits", "count", "following")
        if schedule is not None and not all(hasattr(schedule, name) for name in needed):
            raise ValueError(
                f"commands must be a schedule, such as a CommandTable, with {needed}, not {shown(schedule)}"
            )
        if schedule is not None and schedule.count not in (None, num_envs):
            raise ValueError(f"commands must be for as many humanoids as there are, {num_envs}, not {schedule.count}")
        self.schedule = schedule
        self.gaits = () if schedule is None else check_gaits(schedule.gaits)
        names = () if schedule is None else ("speed", *self.gaits, "style")
        self.names = tuple(f"command.{name}" for name in names)
        """Of the columns: speed, m/s, the weight of each gait, and style."""
        self.values = np.zeros((num_envs, len(names)), np.float32)
        """(N, 2 + G), or (N, 0) without a schedule: the numbers that are observed are those that are rewarded."""
        self._left = np.zeros(num_envs, np.int64)  # control steps for which they hold; 0: no episode has begun
        self._control_step = control_step

    @property
    def speeds(self) -> Array | None:
        """Target speeds (N,), m/s; None without a schedule."""
        return None if self.schedule is None else self.values[:, SPEED].astype(np.float64)

    def begin(self, generator: np.random.Generator, rows: Rows, given: Given = ()) -> None:
        """First commands of episodes of `rows`; `given` of `checked_options` replaces those of all."""
        if self.schedule is not None:
            self._hold(rows, *self.schedule.following(generator, rows, np.zeros(len(rows)), None))
            self._write(given)

    def require_begun(self) -> None:
        """ValueError while humanoids that have commands wait for their first episode."""
        if self.schedule is not None and not self._left.all():
            raise ValueError("reset first: an environment with commands has none before its first reset")

    def advance(self, generator: np.random.Generator, elapsed: NDArray[np.int64]) -> None:
        """Go on to the next control step, with as many of each episode behind it (N,)."""
        if self.schedule is None:
            return
        self._left -= 1
        rows = np.flatnonzero(self._left <= 0)
        if len(rows):
            seconds: Array = elapsed[rows] * np.float64(self._control_step)
            before = self.values[rows].astype(np.float64)
            self._hold(rows, *self.schedule.following(generator, rows, seconds, before))

    def _hold(self, rows: Rows, commands: ArrayLike, seconds: ArrayLike) -> None:
        """Take what a schedule asks of `rows`, which may be a user's own: ValueError where these are no commands."""
        commands, seconds = numbers("commands of the schedule", commands), numbers("seconds of the schedule", seconds)
        shape = (len(rows), len(self.names))
        if commands.shape != shape or seconds.shape != shape[:1]:
            found = f"{commands.shape} and {seconds.shape}"
            raise ValueError(
                f"commands and seconds of the schedule must have shapes {shape} and {shape[:1]}, not {found}"
            )
        check_commands(commands)
        if not (seconds >= 0).all():
            raise ValueError(f"seconds of the schedule must be at least 0, not {seconds[~(seconds >= 0)][0]}")
        self.values[rows] = commands
        self._left[rows] = np.clip(np.ceil(seconds / self._control_step - ROUNDING), 1, _FOREVER)

    def give(self, **asked: Any) -> None:
        """Replace what is asked to the end of each humanoid's episode: `speed`, `gait`, `style`, those not None.

        Numbers for all humanoids or arrays (N,): speeds, m/s; weights of gaits by their names, 0 where one is not
        named; styles. Where anything is given, all else stays at its present value; where nothing is, the schedule
        goes on. ValueError, and no change, without a schedule, before the first episode, for an unknown gait, and for
        what is no command.
        """
        given = self._checked(**asked)
        self.require_begun()
        self._write(given)

    def checked_options(self, options: Any) -> Given:
        """What options of a reset ask for, for `begin`; ValueError for what `give` refuses, and for other options."""
        if options is not None and not isinstance(options, Mapping):
            raise ValueError(f"options must be a mapping of some of {_OPTIONS}, not {shown(options)}")
        unknown = [name for name in options or () if name not in _OPTIONS]
        if unknown:
            raise ValueError(f"option {shown(unknown[0])} is none of {_OPTIONS}")
        return self._checked(**options) if options else ()

    def _checked(
        self,
        *,
        speed: ArrayLike | None = None,
        gait: Mapping[str, ArrayLike] | None = None,
        style: ArrayLike | None = None,
    ) -> Given:
        if self.schedule is None:
            raise ValueError("the environment was made without commands: it takes none")
        count, given = len(self.values), list[tuple[int | slice, Array]]()
        if speed is not None:
            given.append((SPEED, numbers_of_each("speed", speed, count)))
        if gait is not None:
            given.append((WEIGHTS, self._weights(gait)))
        if style is not None:
            given.append((STYLE, numbers_of_each("style", style, count)))
        commands = np.zeros(self.values.shape)
        commands[:, [1, STYLE]] = 1.0
        for columns, values in given:
            commands[:, columns] = values
        check_commands(commands)
        return given

    def _write(self, given: Given) -> None:
        for columns, values in given:
            self.values[:, columns] = values
            self._left[:] = _FOREVER

    def _weights(self, gait: Mapping[str, ArrayLike]) -> Array:
        unknown = [name for name in check_weights_by_name(gait) if name not in self.gaits]
        if unknown:
            raise ValueError(f"gait {shown(unknown[0])} is none of {self.gaits}")
        count = len(self.values)
        weights = [numbers_of_each(f"gait {name}", gait.get(name, 0.0), count) for name in self.gaits]
        return np.stack([np.broadcast_to(weight, count) for weight in weights], axis=-1)

    def beside(self, observation: Float32, rows: Rows | slice = slice(None)) -> Float32:
        """Observations (n, C) of `rows` with the commands as further columns."""
        return observation if self.schedule is None else np.concatenate([observation, self.values[rows]], axis=1)

    def columns_beside(self, columns: NDArray[np.int64], size: int) -> NDArray[np.int64]:
        """Columns of the body's observation (size,), and after them those of the commands."""
        return np.concatenate([columns, size + np.arange(len(self.names))])

    def told(self, **commands: Float32) -> dict[str, Any]:
        """What `info` says of them: these where there are commands, else nothing."""
        return {} if self.schedule is None else commands

    def state(self) -> dict[str, Any]:
        """All that the next commands depend on, but for the random stream and the time since episodes began."""
        return {"names": [*self.names], "values": self.values, "left": self._left}

    def restore(self, state: Any) -> None:
        """Go on from a state, None without a schedule; ValueError, and no change, for one of other commands."""
        if self.schedule is None and state is None:
            return
        own = self.state()
        if self.schedule is None or not isinstance(state, Mapping) or not own.keys() <= state.keys():
            needed = "no commands" if self.schedule is None else f"commands with {[*own]}"
            raise ValueError(f"state must have {needed}, as the environment has, not {shown(state)}")
        if state["names"] != own["names"]:
            raise ValueError(f"state must have the commands {own['names']}, not {shown(state['names'])}")
        values, left = (
            numbers(f"{name} of the state's commands", np.asarray(state[name])) for name in ("values", "left")
        )
        if values.shape != self.values.shape or left.shape != self._left.shape:
            raise ValueError(f"state must have commands of shape {self.values.shape}, not {values.shape}")
        begun = left >= 1
        if not ((left >= 0) & (left <= _FOREVER)).all() or (values[~begun] != 0).any():
            raise ValueError(f"left of the state's commands must be counts of control steps, not {shown(left)}")
        check_commands(values[begun])
        self.values[:], self._left[:] = values, left


class Commanded:
    """The method by which both environments take commands while they run."""

    _commands: CurrentCommands

    @abstractmethod
    def _observe(self) -> tuple[Float32, Array]:
        """What is seen now, and the posture."""

    def command(
        self,
        *,
        speed: ArrayLike | None = None,
        gait: Mapping[str, ArrayLike] | None = None,
        style: ArrayLike | None = None,
    ) -> Float32:
        """Ask for something else from the next step to the end of each episode; what is None stays as it is now.

        The schedule is over for these episodes, unless nothing is given: then nothing changes.

        Numbers for all humanoids, or arrays (N,) of a vector environment. Returns the observations (N, C), or (C,) of
        the one humanoid, of the same states with these commands. ValueError, and no change, for an environment without
        commands, before the first reset, for an unknown gait, and for what is no command.

        Args:
            speed: m/s.
            gait: weights of the gaits by name, such as {"walk": 1.0}, that sum to 1; 0 where one is not named.
            style: share of the leg's stiffness.
        """
        self._commands.give(speed=speed, gait=gait, style=style)
        return self._observe()[0]
