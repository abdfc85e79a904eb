"""What the player of a student that follows commands plays: of each recorded cell the student and its reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.gait.features import BODY_Y, Floats
from romgrl.report.library_cells import CellLine
from romgrl.report.page.scene import gone, humanoid_points, recording, rom_points
from romgrl.report.page.stretches import Stretch, steady_stretch

PLAYED_SECONDS = 4.0  # of a recording in which no strides close
FEWEST_PLAYED = 3


@dataclass(frozen=True)
class CellReference:
    """Of a cell: arrays features (T, 5) m, contact (T, 2), velocity (T,) m/s, episode (T,); feet: what is drawn, m."""

    arrays: Mapping[str, NDArray[Any]]
    feet: Mapping[str, float]


@dataclass(frozen=True)
class PlayedCell:
    """A recorded cell: the student's stretch, and what is drawn of it and of its reference; None: there is none.

    top: the highest point of both, m.
    """

    gait: str
    speed: float
    stretch: Stretch | None
    student: dict[str, Any] | None
    teacher: dict[str, Any] | None
    feet: Mapping[str, float]
    top: float


def played_cells(
    arrays: Mapping[str, NDArray[Any]], references: Mapping[tuple[str, float], CellReference], model: Any
) -> list[PlayedCell]:
    """Of the arrays of recordings.npz, by gait and speed; references: by gait and speed."""
    dt, names = float(arrays["dt"]), [str(name) for name in arrays["gaits"]]
    order = np.lexsort((arrays["cell_speed"], arrays["cell_gait"])).tolist()
    found = []
    for row in order:
        of_row = {name: arrays[f"cell_{name}"][row] for name in ("features", "contact", "velocity", "valid", "states")}
        gait, speed = names[int(arrays["cell_gait"][row])], float(arrays["cell_speed"][row])
        reference = references.get((gait, round(speed, 6)))
        found.append(_played_cell(gait, speed, of_row, reference, model, dt))
    return found


def _played_cell(
    gait: str, speed: float, of_row: Mapping[str, Any], reference: CellReference | None, model: Any, dt: float
) -> PlayedCell:
    valid, contact = of_row["valid"].astype(bool), of_row["contact"].astype(bool)
    episode = np.where(valid, 0, -1)
    features, velocity = of_row["features"].astype(float), of_row["velocity"].astype(float)
    stretch = steady_stretch(features, contact, velocity, episode, dt=dt) or last_seconds(
        features, contact, velocity, valid, dt
    )
    student, teacher, top = None, None, 0.0
    if stretch is not None:
        kept = slice(stretch.first, stretch.first + len(stretch.x))
        points, x = humanoid_points(model, of_row["states"][kept].astype(float))
        student = recording(points, x, stretch.contact, stretch.strides)
        top = float(points[..., 1].max())
    if reference is not None:
        beside = steady_stretch(**reference.arrays, dt=dt)
        if beside is not None:
            teacher = recording(rom_points(beside.features), beside.x, beside.contact, beside.strides)
            top = max(top, float(beside.features[:, BODY_Y].max()))
    return PlayedCell(gait, speed, stretch, student, teacher, reference.feet if reference else {}, top)


def last_seconds(features: Floats, contact: Any, velocity: Floats, valid: Any, dt: float) -> Stretch | None:
    """The end of an episode up to its fall as one stretch that does not close; None where there is next to nothing."""
    stop = len(valid) if valid.all() else int(np.argmin(valid))
    first = max(0, stop - round(PLAYED_SECONDS / dt))
    if stop - first < FEWEST_PLAYED:
        return None
    kept = slice(first, stop)
    steps = stop - first
    return Stretch(features[kept], contact[kept], gone(velocity[kept], dt), [0, steps - 1], first)


def cell_table(cells: Sequence[PlayedCell], student: pd.DataFrame) -> pd.DataFrame:
    """A row for each played cell: gait, speed_m_per_s, apex_m, and `fit`: the student does not fall there."""
    upright = {
        (gait, round(float(speed), 6)): not falls
        for gait, speed, falls in zip(student.gait, student.speed_m_per_s, student.falls, strict=True)
    }
    rows = [(cell.gait, cell.speed, 0.0, upright.get((cell.gait, round(cell.speed, 6)), False)) for cell in cells]
    return pd.DataFrame(rows, columns=["gait", "speed_m_per_s", "apex_m", "fit"])


def gait_lines(table: pd.DataFrame) -> list[CellLine]:
    """A line for each gait of `cell_table`."""
    return [CellLine(1.0, str(gait), 0, 0, rows) for gait, rows in table.groupby("gait")]


def played_walkers(cells: Sequence[PlayedCell]) -> dict[str, dict[str, Any]]:
    """The walkers of the player: a student by the number of its cell, the reference by `teacher` before it."""
    students = {str(number): cell.student for number, cell in enumerate(cells)}
    teachers = {f"teacher {number}": cell.teacher for number, cell in enumerate(cells)}
    return {name: walker for name, walker in (students | teachers).items() if walker is not None}
