"""When humanoids are asked for what: commands drawn at random for a training, or read from a table.

A command (2 + G,) is a target speed, m/s, one weight for each of G gaits, which sum to 1, and a style, the share of a
leg's stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
_Range = tuple[float, float]

SPEED, WEIGHTS, STYLE = 0, slice(1, -1), -1
"""Columns of a command."""
ROUNDING = 1e-6
"""Seconds, or control steps, by which a change may seem to be late and is not."""


class CommandSchedule(Protocol):
    """What is asked of humanoids, and when something else is."""

    @property
    def gaits(self) -> Sequence[str]:
        """Names of the G weights."""

    @property
    def count(self) -> int | None:
        """Humanoids that it is for; None: any number."""

    def following(
        self, generator: np.random.Generator, rows: Rows, seconds: Array, before: Array | None
    ) -> tuple[Array, Array]:
        """Commands (n, 2 + G) for `rows` (n,) of the humanoids, and for how long each is held (n,), s.

        A command is held for one control step at least; infinity: to the end of the episode.

        seconds: since their episodes began (n,); before: their commands until now (n, 2 + G), None at the beginning.
        """


@dataclass(frozen=True)
class DrawnCommands:
    """Commands of one pure gait each, drawn for every humanoid by itself and held for a while; all ranges are uniform.

    An episode begins with a speed from anywhere in the range of its gait, and so does the share `step_share` of later
    commands. The others are within `near` of the speed before, or as close to it as the range of the gait permits.
    The share `standing_share` of all is a speed of 0. ValueError for ranges and shares that are none.
    """

    gaits: Sequence[str]
    """Drawn with equal probability."""
    speeds: _Range | Mapping[str, _Range]
    """Range, m/s, or one for each gait."""
    styles: _Range = (1.0, 1.0)
    hold_seconds: _Range = (3.0, 8.0)
    step_share: float = 0.1
    near: float = 1.0
    """m/s."""
    standing_share: float = 0.05

    def __post_init__(self) -> None:
        _check_gaits(self.gaits)
        if isinstance(self.speeds, Mapping) and set(self.speeds) != set(self.gaits):
            raise ValueError(f"speeds must have a range for each of the gaits {[*self.gaits]}, not {[*self.speeds]}")
        speeds = self.speeds if isinstance(self.speeds, Mapping) else {"every gait": self.speeds}
        for name, limits in speeds.items():
            _check_range(f"speeds of {name}", limits)
        _check_range("styles", self.styles, positive=True)
        _check_range("hold_seconds", self.hold_seconds, positive=True)
        if not 0 <= self.near < np.inf:
            raise ValueError(f"near must be at least 0, not {self.near}")
        for name in ("step_share", "standing_share"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be between 0 and 1, not {getattr(self, name)}")

    @property
    def count(self) -> int | None:
        """Any number of humanoids."""
        return None

    @cached_property
    def _speeds(self) -> Array:
        """Range of each gait (G, 2)."""
        speeds = self.speeds
        return np.array([speeds[gait] if isinstance(speeds, Mapping) else speeds for gait in self.gaits], np.float64)

    def following(
        self, generator: np.random.Generator, rows: Rows, seconds: Array, before: Array | None
    ) -> tuple[Array, Array]:
        """Drawn anew, with the time for which each is held."""
        count = len(rows)
        gait = generator.integers(len(self.gaits), size=count)
        low, high = self._speeds[gait].T
        if before is not None:
            near = generator.random(count) >= self.step_share
            least, most = (np.clip(before[:, SPEED] + off, low, high) for off in (-self.near, self.near))
            low, high = np.where(near, least, low), np.where(near, most, high)
        commands = np.zeros((count, len(self.gaits) + 2))
        commands[:, SPEED] = generator.uniform(low, high)
        commands[generator.random(count) < self.standing_share, SPEED] = 0.0
        commands[np.arange(count), 1 + gait] = 1.0
        commands[:, STYLE] = generator.uniform(*self.styles, size=count)
        return commands, generator.uniform(*self.hold_seconds, size=count)


@dataclass(frozen=True, eq=False)
class CommandTable:
    """Commands at T times of an episode, for all humanoids or for each of N; the last one holds to the end.

    ValueError for shapes that do not fit, times that do not rise from 0, and numbers that are no command.
    """

    gaits: Sequence[str]
    times: ArrayLike
    """Since the episode began (T,), s; the first is 0."""
    speeds: ArrayLike
    """Number, (T,) or (T, N), m/s."""
    weights: ArrayLike
    """(G,), (T, G) or (T, N, G)."""
    styles: ArrayLike = 1.0
    """Number, (T,) or (T, N)."""
    ramp: bool = False
    """True: straight from one row to the next; False: a row is held until the next one."""

    @classmethod
    def constant(cls, speed: ArrayLike, gait: Mapping[str, ArrayLike], style: ArrayLike = 1.0) -> CommandTable:
        """One command, or one for each humanoid, of numbers or arrays (N,); `gait` names all gaits that there are."""
        _check_gaits([*gait])
        weights = np.stack(np.broadcast_arrays(*gait.values()), axis=-1)
        return cls([*gait], [0.0], np.array(speed, ndmin=2), np.array(weights, ndmin=3), np.array(style, ndmin=2))

    def __post_init__(self) -> None:
        _check_gaits(self.gaits)
        times = self._times
        if times.ndim != 1 or not len(times) or times[0] != 0 or not (np.diff(times) > 0).all() or np.isinf(times[-1]):
            raise ValueError(f"times must rise from 0, not be {times}")
        check_commands(self._commands)

    @property
    def count(self) -> int | None:
        """N where humanoids have commands of their own."""
        return None if self._commands.shape[1] == 1 else self._commands.shape[1]

    @cached_property
    def _times(self) -> Array:
        return np.array(self.times, dtype=np.float64)

    @cached_property
    def _commands(self) -> Array:
        """(T, N, 2 + G), or (T, 1, 2 + G) for all humanoids."""
        speeds, weights, styles = (
            np.array(values, dtype=np.float64) for values in (self.speeds, self.weights, self.styles)
        )
        if weights.shape[-1:] != (len(self.gaits),):
            raise ValueError(f"weights must have {len(self.gaits)} columns, one for each gait, not {weights.shape}")
        try:
            parts = [_by_humanoid(speeds[..., None]), _by_humanoid(weights), _by_humanoid(styles[..., None])]
            shape = np.broadcast_shapes((len(self._times), 1), *(part.shape[:2] for part in parts))
            if shape[0] != len(self._times):
                raise ValueError("more rows than times")
            return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1)
        except ValueError as error:
            shapes = f"speeds {speeds.shape}, weights {weights.shape} and styles {styles.shape}"
            raise ValueError(f"{shapes} do not fit {len(self._times)} times and one number of humanoids") from error

    def following(
        self, generator: np.random.Generator, rows: Rows, seconds: Array, before: Array | None
    ) -> tuple[Array, Array]:
        """What the table says at these times, and until when."""
        times, commands = self._times, self._commands
        last, column = len(times) - 1, np.minimum(rows, commands.shape[1] - 1)
        row = np.searchsorted(times, seconds + ROUNDING, side="right") - 1
        after = np.minimum(row + 1, last)
        found: Array = commands[row, column]
        if not self.ramp:
            return found, np.where(row < last, times[after] - seconds, np.inf)
        share = (seconds - times[row]) / np.where(row < last, times[after] - times[row], 1.0)
        found += np.clip(share, 0.0, 1.0)[:, None] * (commands[after, column] - found)
        return found, np.where(row < last, 0.0, np.inf)


def check_commands(commands: Array) -> None:
    """ValueError unless these (..., 2 + G) are commands."""
    speed, weights, style = commands[..., SPEED], commands[..., WEIGHTS], commands[..., STYLE]
    for name, values, good, needed in (
        ("speed", speed, np.isfinite(speed) & (speed >= 0), "at least 0"),
        ("style", style, np.isfinite(style) & (style > 0), "positive"),
    ):
        if not good.all():
            raise ValueError(f"{name} must be {needed}, not {values[~good][0]}")
    good = (weights >= 0).all(axis=-1) & (np.abs(weights.sum(axis=-1) - 1.0) <= ROUNDING)
    if not good.all():
        raise ValueError(f"weights of the gaits must be at least 0 and sum to 1, not {weights[~good][0].tolist()}")


def _check_gaits(gaits: Sequence[str]) -> None:
    if isinstance(gaits, str) or not gaits or len({*gaits}) < len(gaits):
        raise ValueError(f"gaits must be one or more different names, not {gaits!r}")


def _check_range(name: str, limits: _Range, *, positive: bool = False) -> None:
    if len(limits) != 2 or not 0 <= limits[0] <= limits[1] < np.inf or (positive and limits[0] == 0):
        raise ValueError(f"{name} must be a range {'above' if positive else 'from'} 0, not {limits}")


def _by_humanoid(values: Array) -> Array:
    """(T, N, columns) of values (columns,), (T, columns) or (T, N, columns), with 1 where they lack an axis."""
    leading, columns = values.shape[:-1], values.shape[-1]
    return values.reshape(*leading, *(1,) * (2 - len(leading)), columns)
