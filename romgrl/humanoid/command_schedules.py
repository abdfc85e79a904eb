"""When humanoids are asked for what: commands drawn at random for a training, or read from a table.

A command (2 + G,) is a target speed, m/s, one weight for each of G gaits, which sum to 1, and a style, the share of a
leg's stiffness, which the reduced-order model and its teachers call `stiffness_share`: the `Commands` of
`romgrl.rom.parameters` are another class.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from romgrl.humanoid.command_checks import (
    FASTEST_COMMAND,
    ROUNDING,
    SPEED,
    STIFFEST_STYLE,
    STYLE,
    Array,
    Rows,
    check_commands,
    check_gaits,
    check_range,
    check_weights_by_name,
    number_between,
    numbers,
    numbers_of_each,
    shown,
)

_Range = tuple[float, float]


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

    _ranges: Array = field(init=False, repr=False, compare=False)
    """Speeds of each gait (G, 2)."""

    def __post_init__(self) -> None:
        gaits, speeds = check_gaits(self.gaits), self.speeds
        if isinstance(speeds, Mapping) and set(speeds) != set(gaits):
            raise ValueError(f"speeds must have a range for each of the gaits {shown(gaits)}, not {shown([*speeds])}")
        ranges = (
            {gait: check_range(f"speeds of {gait}", speeds[gait], top=FASTEST_COMMAND) for gait in gaits}
            if isinstance(speeds, Mapping)
            else dict.fromkeys(gaits, check_range("speeds", speeds, top=FASTEST_COMMAND))
        )
        kept = {
            "gaits": gaits,
            "speeds": ranges if isinstance(speeds, Mapping) else ranges[gaits[0]],
            "styles": check_range("styles", self.styles, top=STIFFEST_STYLE, positive=True),
            "hold_seconds": check_range("hold_seconds", self.hold_seconds, positive=True),
            "near": number_between("near", self.near),
            "step_share": number_between("step_share", self.step_share, 1.0),
            "standing_share": number_between("standing_share", self.standing_share, 1.0),
            "_ranges": np.array([ranges[gait] for gait in gaits]),
        }
        for name, value in kept.items():  # what was given may be a list or a mapping that changes afterwards
            object.__setattr__(self, name, value)

    @property
    def count(self) -> int | None:
        """Any number of humanoids."""
        return None

    def following(
        self, generator: np.random.Generator, rows: Rows, seconds: Array, before: Array | None
    ) -> tuple[Array, Array]:
        """Drawn anew, with the time for which each is held."""
        count = len(rows)
        gait = generator.integers(len(self.gaits), size=count)
        low, high = self._ranges[gait].T
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
        check_gaits([*check_weights_by_name(gait)])
        weights = [numbers_of_each(f"gait {name}", weight) for name, weight in gait.items()]
        try:
            together = np.stack(np.broadcast_arrays(*weights), axis=-1)
        except ValueError as error:
            raise ValueError(f"gait must have as many weights for each name, not {shown(gait)}") from error
        asked, styles = numbers_of_each("speed", speed), numbers_of_each("style", style)
        return cls([*gait], [0.0], np.array(asked, ndmin=2), np.array(together, ndmin=3), np.array(styles, ndmin=2))

    def __post_init__(self) -> None:
        object.__setattr__(self, "gaits", check_gaits(self.gaits))
        times = self._times
        if times.ndim != 1 or not len(times) or times[0] != 0 or not (np.diff(times) > 0).all() or np.isinf(times[-1]):
            raise ValueError(f"times must rise from 0, not be {shown(times.tolist())}")
        check_commands(self._commands)

    @property
    def count(self) -> int | None:
        """N where humanoids have commands of their own."""
        return None if self._commands.shape[1] == 1 else self._commands.shape[1]

    @cached_property
    def _times(self) -> Array:
        return numbers("times", self.times)

    @cached_property
    def _commands(self) -> Array:
        """(T, N, 2 + G), or (T, 1, 2 + G) for all humanoids."""
        weights = numbers("weights", self.weights)
        if weights.shape[-1:] != (len(self.gaits),):
            raise ValueError(
                f"weights must have {len(self.gaits)} columns, one for each gait, not shape {weights.shape}"
            )
        speeds, styles = numbers("speeds", self.speeds), numbers("styles", self.styles)
        parts = [
            self._by_humanoid(name, values)
            for name, values in (("speeds", speeds[..., None]), ("weights", weights), ("styles", styles[..., None]))
        ]
        counts = sorted({part.shape[1] for part in parts} - {1})
        if len(counts) > 1:
            raise ValueError(f"speeds, weights and styles must be for one number of humanoids, not for {counts}")
        shape = (len(self._times), counts[0] if counts else 1)
        return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1)

    def _by_humanoid(self, name: str, values: Array) -> Array:
        """(T, N, columns) of values (columns,), (T, columns) or (T, N, columns), with 1 where they lack an axis."""
        *leading, columns = values.shape
        if len(leading) > 2 or leading[:1] not in ([], [1], [len(self._times)]) or 0 in leading:
            raise ValueError(
                f"{name} must be for {len(self._times)} times and 1 or more humanoids, not {tuple(leading)}"
            )
        return values.reshape(*leading, *(1,) * (2 - len(leading)), columns)

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
