"""A walker at every cell of the grid of commands: rows of grid.csv and confusion.csv, and what null models score."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from romgrl.gait.alignment import error_over_variance, last_windows
from romgrl.gait.command_following import speed_tolerance
from romgrl.gait.features import Floats, Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.gait_classes import CLASSES, OF_NO_GAIT, classified
from romgrl.gait.human_bands import COMPARED_WITH, outside
from romgrl.gait.metrics import ENERGY_MEASURES, describe
from romgrl.gait.null_models import null_models
from romgrl.provenance.grid_episodes import EPISODE_SECONDS
from romgrl.stages.conditioned.asked_episodes import Arrays, Asked, TableRow, Walked, Walker, blocks, made_once
from romgrl.stages.conditioned.cells import CommandCells

CELLS_PART = 0
"""Of the evaluation, `Walker.block`."""
NULL_WALKERS = ("sinusoid", "statue")


@dataclass(frozen=True)
class GridCells:
    """The cells of a library as what walkers are measured by; `window`: last steps that are scored."""

    cells: CommandCells
    window: int

    @property
    def count(self) -> int:
        """Of the cells."""
        return len(self.cells.speed)

    @property
    def names(self) -> list[str]:
        """As in `run 3.25`."""
        return [f"{self.gait(cell)} {self.cells.speed[cell]:g}" for cell in range(self.count)]

    def gait(self, cell: int) -> str:
        """Name of the gait of a cell."""
        return self.cells.gaits[int(self.cells.gait[cell])]

    def asked(self, cell: int) -> Asked:
        """The command of a cell, held throughout."""
        weights = tuple(float(number == self.cells.gait[cell]) for number in range(len(self.cells.gaits)))
        return Asked((0.0,), (float(self.cells.speed[cell]),), (weights,))

    def row(self, walker: str, cell: int, gait: Gait, teacher: Gait, mass: float | None = None) -> TableRow:
        """Of grid.csv, without what the walker's gait is classified as."""
        asked, name = float(self.cells.speed[cell]), self.gait(cell)
        found = describe(gait, target_speed=asked, mass=mass, hops=FOOTFALLS[name].together)
        error = error_over_variance(gait, teacher, self.window)
        off = found["steady_speed_m_per_s"] - asked
        head: TableRow = {
            "walker": walker,
            "gait": name,
            "speed_m_per_s": asked,
            "taught": bool(self.cells.taught[cell]),
        }
        head |= {name: found.pop(name) for name in ("episodes", "falls", "steady_speed_m_per_s")}
        del found["target_speed_m_per_s"]
        head |= {
            "speed_error_m_per_s": off,
            "speed_held": bool(abs(off) <= speed_tolerance(asked)),
            "error_over_variance": float(error.mean()),
            "largest_error_over_variance": float(error.max()),
            "error_over_specialist": math.nan,
            "obeyed_gait": math.nan,
        }
        bands = outside(found | head, asked, COMPARED_WITH.get(name, ()))
        return head | found | {"outside_human_bands": " ".join(bands)}

    def reference_rows(self, cell: int) -> list[TableRow]:
        """Of the reference, against itself, and of what was made of it without learning."""
        teacher = self.cells.teacher(cell)
        row = self.row("teacher", cell, teacher, teacher) | self.classes(cell, teacher)
        recorded = self.cells.table.iloc[cell].to_dict()  # what a library keeps of energy is in its table alone
        row |= {name: float(recorded[name]) for name in ENERGY_MEASURES if name in recorded}
        episodes = teacher.upright_episodes
        steps = max(self.window, round(EPISODE_SECONDS / teacher.dt))
        models, _ = null_models(episodes, teacher.dt, row["stride_frequency_hz"], math.nan, steps)
        found = [row]
        for name in NULL_WALKERS:
            if name not in models:
                continue
            made = np.stack(models[name].episodes)
            still = Gait(made, np.ones(made.shape[:2], bool), np.zeros(len(made), bool), teacher.dt)
            found.append(self.row(name, cell, still, teacher) | {"outside_human_bands": ""})
        return found

    def classes(self, cell: int, gait: Gait) -> TableRow:
        """The share of the episodes that are of the gait asked for, and how many are of which."""
        counts = Counter(classified(gait))
        return {
            "obeyed_gait": counts[self.gait(cell)] / len(gait.features),
            "counts": {name: counts[name] for name in (*CLASSES, OF_NO_GAIT)},
        }

    def windows(self, features: Floats, upright: Floats) -> Floats:
        """What is scored of the episodes (E, T, 5) of a cell that do not fall (E,)."""
        return last_windows([*features[upright.astype(bool)].astype(float)], self.window)


def walk_cells(
    grid: GridCells, name: str, walker: Walker, mass: float, episodes: int, directory: Path
) -> tuple[list[TableRow], Arrays]:
    """Rows of a walker, and of each cell features (C, E, T, 5) and upright (C, E), of one episode `Walked.longest`.

    Blocks that are finished in `directory` are not walked again.
    """
    steps = round(EPISODE_SECONDS / grid.cells.dt)
    asked = [grid.asked(cell) for cell in range(grid.count)]
    rows: list[TableRow] = []
    parts: list[Arrays] = []
    for number, block in enumerate(blocks(asked, episodes * steps)):
        first = len(rows)

        def make(block: Sequence[Asked] = block, number: int = number, first: int = first) -> tuple[Any, Arrays]:
            walked = walker.block(block, episodes, steps, CELLS_PART, number)
            return measure_block(grid, name, walked, first, mass)

        numbers, arrays = made_once(directory / f"{name}_cells_{number:03d}.npz", make)
        rows += numbers
        parts.append(arrays)
    return rows, {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}


def measure_block(grid: GridCells, name: str, walked: list[Walked], first: int, mass: float) -> tuple[Any, Arrays]:
    """Rows and arrays of cells in a row, the first of which is number `first`."""
    rows, arrays = [], []
    for cell, each in enumerate(walked, first):
        teacher = grid.cells.teacher(cell)
        rows.append(grid.row(name, cell, each.gait, teacher, mass) | grid.classes(cell, each.gait))
        recorded = {f"recorded_{key}": value for key, value in each.longest().items()}
        arrays.append(recorded | {"features": each.gait.features, "upright": ~each.gait.fallen})
    return rows, {key: np.stack([each[key] for each in arrays]) for key in arrays[0]}
