"""The references of a finished library that a student is asked for: fit ones, of legs of the usual stiffness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.config.commanded import conditioned_keys
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import Gait, episode_bounds, gait_from_reference
from romgrl.humanoid.cell_states import CellStates
from romgrl.provenance.taught_cells import can_teach, is_taught
from romgrl.report.finished_library import read_library


@dataclass(frozen=True)
class CommandCells:
    """C references, sorted by gait and speed, and what is asked for each.

    Of each cell: `gait`, number of its gait among `gaits`, speed, m/s, `taught`, and arrays features (T, 5), episode
    (T,), velocity (T,), m/s, contact (T, 2). `table`: its row of library.csv.
    """

    gaits: tuple[str, ...]
    gait: NDArray[np.int64]
    speed: NDArray[np.float64]
    taught: NDArray[np.bool_]
    references: Sequence[Mapping[str, NDArray[Any]]]
    dt: float
    table: pd.DataFrame

    def name(self, cell: int) -> str:
        """As in `run at 3.25 m/s`."""
        return f"{self.gaits[self.gait[cell]]} at {self.speed[cell]:g} m/s"

    def teacher(self, cell: int) -> Gait:
        """The reference of a cell."""
        return gait_from_reference({**self.references[cell], "dt": np.array(self.dt)})

    @cached_property
    def ranges(self) -> NDArray[np.float64]:
        """Slowest and fastest speed that each gait is asked for (G, 2), m/s, its references taught or not."""
        of_gait = [self.speed[self.gait == number] for number in range(len(self.gaits))]
        return np.array([(speeds.min(), speeds.max()) for speeds in of_gait])

    @property
    def taught_cells(self) -> list[int]:
        """Numbers of the cells that are taught."""
        return np.flatnonzero(self.taught).tolist()

    def states(self, model: mujoco.MjModel) -> CellStates:
        """Where episodes may begin: in poses of the taught cells."""
        taught, parts = self.taught_cells, [self.references[cell] for cell in self.taught_cells]
        steps = [len(part["episode"]) for part in parts]
        apart = np.cumsum([0, *(int(part["episode"].max()) + 1 for part in parts[:-1])])
        return CellStates(
            model,
            np.concatenate([part["features"] for part in parts]),
            np.concatenate([part["episode"] + first for part, first in zip(parts, apart, strict=True)]),
            self.dt,
            np.repeat(np.arange(len(parts)), steps),
            self.gait[taught],
            self.speed[taught],
        )


def read_command_cells(directory: Path, config: Config, *, span: int) -> CommandCells:
    """The cells of a finished library; raises ArtifactError where none can be taught.

    An episode of each that is taught has `span` steps at least. A gait of which no cell is taught is left out.
    """
    dt = 1.0 / config.humanoid.control_frequency
    library = read_library(directory, steps=config.reference.steps, dt=dt)
    table, step = library.table, conditioned_keys(config.student).taught_step
    rows = table[can_teach(table)].sort_values(["gait", "speed_m_per_s"])
    speeds = rows.speed_m_per_s.to_numpy(float)
    taught = np.array([is_taught(speed, step) for speed in speeds], bool)
    gaits = tuple(sorted({*rows.gait[taught]}))
    if not gaits:
        at = "" if step is None else f" at multiples of {step:g} m/s"
        raise ArtifactError(f"{directory}: no cell{at} is fit, on legs of the usual stiffness")
    kept = rows.gait.isin(gaits).to_numpy()
    references = [cell_arrays(library.arrays, int(row)) for row in rows.index[kept]]
    cells = CommandCells(
        gaits,
        np.array([gaits.index(gait) for gait in rows.gait[kept]]),
        speeds[kept],
        taught[kept],
        references,
        dt,
        rows[kept].reset_index(drop=True),
    )
    for cell in cells.taught_cells:
        longest = max(stop - start for start, stop in episode_bounds(references[cell]["episode"]))
        if longest < max(span, 4):
            raise ArtifactError(f"{directory}: {cells.name(cell)}: {longest} steps in a row; needed: {max(span, 4)}")
    return cells


def cell_arrays(arrays: Mapping[str, NDArray[Any]], row: int) -> dict[str, NDArray[Any]]:
    """What library.npz has of a row of library.csv, without what lacks at the end."""
    there = arrays["episode"][row] >= 0
    return {name: arrays[name][row][there] for name in ("features", "episode", "velocity", "contact")}
