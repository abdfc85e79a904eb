"""What humanoids are asked for while they run: the commands of now, their columns, and how a user gives others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romgrl.humanoid.command_schedules import (
    ROUNDING,
    SPEED,
    STYLE,
    WEIGHTS,
    Array,
    CommandSchedule,
    Rows,
    check_commands,
)

Float32 = NDArray[np.float32]

_FOREVER = 10**15
"""Control steps that no episode has."""
_OPTIONS = ("speed", "gait", "style")


class CurrentCommands:
    """The command of each of N humanoids; without a schedule there are none, and nothing is drawn or observed.

    Args:
        schedule: what is asked, and when.
        num_envs: humanoids; ValueError where the schedule is for another number.
        control_step: duration of a control step, s.
    """

    def __init__(self, schedule: CommandSchedule | None, num_envs: int, control_step: float) -> None:
        if schedule is not None and schedule.count not in (None, num_envs):
            raise ValueError(f"commands are for {schedule.count} humanoids, not for num_envs = {num_envs}")
        self.gaits = () if schedule is None else tuple(schedule.gaits)
        names = () if schedule is None else ("speed", *self.gaits, "style")
        self.names = tuple(f"command.{name}" for name in names)
        """Of the columns: speed, m/s, the weight of each gait, and style."""
        self.values = np.zeros((num_envs, len(names)), np.float32)
        """(N, 2 + G), or (N, 0) without a schedule: the numbers that are observed are those that are rewarded."""
        self._left = np.zeros(num_envs, np.int64)  # control steps for which they hold
        self._schedule, self._control_step = schedule, control_step

    @property
    def speeds(self) -> Array | None:
        """Target speeds (N,), m/s; None without a schedule."""
        return None if self._schedule is None else self.values[:, SPEED].astype(np.float64)

    def begin(self, generator: np.random.Generator, rows: Rows) -> None:
        """First commands of episodes of `rows`."""
        if self._schedule is not None:
            self._hold(rows, *self._schedule.following(generator, rows, np.zeros(len(rows)), None))

    def advance(self, generator: np.random.Generator, elapsed: NDArray[np.int64]) -> None:
        """Go on to the next control step, with as many of each episode behind it (N,)."""
        if self._schedule is None:
            return
        self._left -= 1
        rows = np.flatnonzero(self._left <= 0)
        if len(rows):
            seconds: Array = elapsed[rows] * np.float64(self._control_step)
            before = self.values[rows].astype(np.float64)
            self._hold(rows, *self._schedule.following(generator, rows, seconds, before))

    def _hold(self, rows: Rows, commands: Array, seconds: Array) -> None:
        self.values[rows] = commands
        self._left[rows] = np.clip(np.ceil(seconds / self._control_step - ROUNDING), 1, _FOREVER)

    def give(
        self,
        *,
        speed: ArrayLike | None = None,
        gait: Mapping[str, ArrayLike] | None = None,
        style: ArrayLike | None = None,
    ) -> None:
        """Replace what the schedule asks to the end of each humanoid's episode; what is None stays as it is.

        Numbers for all humanoids or arrays (N,): speeds, m/s; weights of gaits by their names, 0 where one is not
        named; styles. ValueError, and no change, without a schedule, for an unknown gait, and for what is no command.
        """
        if self._schedule is None:
            raise ValueError("the environment was made without commands: it takes none")
        values = self.values.astype(np.float64)
        if speed is not None:
            values[:, SPEED] = self._numbers("speed", speed)
        if gait is not None:
            values[:, WEIGHTS] = self._weights(gait)
        if style is not None:
            values[:, STYLE] = self._numbers("style", style)
        check_commands(values)
        self.values[:], self._left[:] = values, _FOREVER

    def give_options(self, options: Mapping[str, Any] | None) -> None:
        """`give` with the options of a reset; ValueError for options that it does not know."""
        unknown = [name for name in options or () if name not in _OPTIONS]
        if unknown:
            raise ValueError(f"option {unknown[0]!r} is none of {_OPTIONS}")
        if options:
            self.give(**options)

    def _weights(self, gait: Mapping[str, ArrayLike]) -> Array:
        if not isinstance(gait, Mapping):
            raise ValueError(f"gait must have a weight for each name, such as {{{self.gaits[0]!r}: 1.0}}, not {gait!r}")
        unknown = [name for name in gait if name not in self.gaits]
        if unknown:
            raise ValueError(f"gait {unknown[0]!r} is none of {self.gaits}")
        return np.stack([self._numbers(f"gait {name}", gait.get(name, 0.0)) for name in self.gaits], axis=-1)

    def _numbers(self, name: str, values: ArrayLike) -> Array:
        """One for each humanoid (N,)."""
        try:
            return np.broadcast_to(np.asarray(values, dtype=np.float64), len(self.values))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{name} must be a number or {len(self.values)} of them, not {values!r}") from error

    def beside(self, observation: Float32, rows: Rows | slice = slice(None)) -> Float32:
        """Observations (n, C) of `rows` with the commands as further columns."""
        return observation if self._schedule is None else np.concatenate([observation, self.values[rows]], axis=1)

    def columns_beside(self, columns: NDArray[np.int64], size: int) -> NDArray[np.int64]:
        """Columns of the body's observation (size,), and after them those of the commands."""
        return np.concatenate([columns, size + np.arange(len(self.names))])

    def told(self, acted: Float32) -> dict[str, Float32]:
        """What `info` says of them: those that `acted` in the step (N, 2 + G), and those of the next one."""
        return {} if self._schedule is None else {"command": acted, "reset_command": self.values.copy()}

    def state(self) -> dict[str, Any]:
        """All that the next commands depend on, but for the random stream and the time since episodes began."""
        return {"values": self.values, "left": self._left}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.values[:], self._left[:] = state["values"], state["left"]
