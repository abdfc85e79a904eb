"""Poses that follow the references of a library: those of the cell that is nearest to the command of an episode."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from romgrl.humanoid.command_checks import SPEED, WEIGHTS
from romgrl.humanoid.reference_states import ReferenceStates
from romgrl.humanoid.start_states import Commanding

FAR = 100.0
"""m/s: another gait is further off than any speed."""


@dataclass(frozen=True)
class CellStates(ReferenceStates):
    """As `ReferenceStates`, of several cells in a row: no episode of one has a neighbour in another with its number.

    Raises ValueError where no episode of a cell holds four steps.
    """

    cell: NDArray[np.int64]
    """Of each step (N,), rising from 0 to C - 1."""
    gait: NDArray[np.int64]
    """Column of the weights of each cell's gait (C,)."""
    speed: NDArray[np.float64]
    """Of each cell, m/s (C,)."""

    def __post_init__(self) -> None:
        if (self.count == 0).any():
            raise ValueError("no episode of a cell's reference holds four steps")

    @cached_property
    def count(self) -> NDArray[np.int64]:
        """Steps of `middle` that each cell has (C,)."""
        return np.bincount(self.cell[self.middle], minlength=len(self.speed))

    def nearest(self, commands: NDArray[np.float32]) -> NDArray[np.int64]:
        """The cell (n,) of the gait and nearest speed of each command (n, 2 + G)."""
        other = commands[:, WEIGHTS].argmax(axis=1)[:, None] != self.gait
        found: NDArray[np.int64] = (np.abs(commands[:, SPEED, None] - self.speed) + FAR * other).argmin(axis=1)
        return found

    def drawn_steps(self, generator: np.random.Generator, count: int, commands: Commanding) -> NDArray[np.int64]:
        """Of the nearest cells; ValueError without commands."""
        if commands is None:
            raise ValueError("states of cells are for humanoids that have commands")
        cells = self.nearest(commands)
        first = np.cumsum(self.count) - self.count
        drawn: NDArray[np.int64] = self.middle[first[cells] + generator.integers(self.count[cells])]
        return drawn
