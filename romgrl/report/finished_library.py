"""A finished library, verified and read, and several of them as one (`library.others`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.artifacts import Manifest, load_arrays, open_artifact
from romgrl.artifacts.payload import reading
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS

CELL_COLUMNS = ("gait", "speed_m_per_s", "stiffness_share", "fit", "reason")
RECORDED = {"features": (len(CHANNELS),), "contact": (2,), "velocity": (), "episode": ()}
"""Arrays of library.npz with a row for each cell, and the shape of a step of theirs."""
DT_TOLERANCE = 1e-6  # of dt
GOAL_DIGITS = 6  # after the point: multiples of two steps that meet may differ in their last bits


class AskedCell(NamedTuple):
    """What two cells may not have in common; speed m/s, apex m, share: of the stiffness."""

    gait: str
    speed: float
    apex: float
    share: float

    def __str__(self) -> str:
        goal = f"to {self.apex:g} m" if self.apex else f"at {self.speed:g} m/s"
        return f"{self.gait} {goal}, stiffness × {self.share:g}"


@dataclass(frozen=True)
class FinishedLibrary:
    """table: library.csv (C rows); arrays: library.npz."""

    table: pd.DataFrame
    arrays: dict[str, NDArray[Any]]


def read_library(directory: Path, *, steps: int, dt: float) -> FinishedLibrary:
    """A library of `steps` steps of dt s a cell. Raises ArtifactError for what is none, damaged or of other steps."""
    manifest = open_artifact(directory, stage="library")
    with reading(directory / "library.csv"):
        table = pd.read_csv(directory / "library.csv", dtype={"reason": str})
    missing = [name for name in CELL_COLUMNS if name not in table]
    if missing or table.empty:
        raise ArtifactError(f"{directory / 'library.csv'}: no {'column ' + ', '.join(missing) if missing else 'rows'}")
    path = directory / "library.npz"
    arrays = load_arrays(path)
    missing = [name for name in (*RECORDED, "channels", "dt") if name not in arrays]
    if missing:
        raise ArtifactError(f"{path}: no array {', '.join(missing)}")
    for name, of_step in RECORDED.items():
        if arrays[name].shape != (len(table), steps, *of_step):
            raise ArtifactError(f"{path}: {name} is {arrays[name].shape}; needed: {(len(table), steps, *of_step)}")
    if arrays["channels"].tolist() != list(CHANNELS):
        raise ArtifactError(f"{path}: channels are not {', '.join(CHANNELS)}")
    found = float(arrays["dt"]) if arrays["dt"].dtype.kind == "f" and arrays["dt"].ndim == 0 else np.nan
    if not abs(found - dt) <= DT_TOLERANCE * dt:
        raise ArtifactError(f"{path}: dt {found:.6g}; needed: {dt:.6g}")
    return FinishedLibrary(with_origin(table.fillna({"reason": ""}), manifest), arrays)


def with_origin(table: pd.DataFrame, manifest: Manifest) -> pd.DataFrame:
    """library.csv with what older ones lack: no apex; feet and teacher as the manifest has them, a radius or nan."""
    if "apex_m" not in table:
        table = table.assign(apex_m=0.0)
    if "teacher" not in table:
        settings = manifest.config
        how = f"a {table.gait.iloc[0]} by {settings.get('teacher.algorithm', 'ppo')}, seed {manifest.seed}"
        radius = settings.get("rom.foot_radius")
        table = table.assign(foot_radius_m=np.nan if radius is None else radius)
        table = table.assign(teacher=f"{how}, library {manifest.key}")
    if "roll_over_radius_m" not in table:
        table = table.assign(roll_over_radius_m=float(manifest.config.get("rom.roll_over_radius", 0.0)))
    return table


def joined_library(first: FinishedLibrary, others: Sequence[FinishedLibrary]) -> FinishedLibrary:
    """The cells of all, those of `first` first. A foot radius that is not known is that of the first."""
    libraries = [first, *others]
    table = pd.concat([each.table for each in libraries], ignore_index=True)
    table["foot_radius_m"] = table.foot_radius_m.fillna(first.table.foot_radius_m.iloc[0])
    arrays = {name: np.concatenate([each.arrays[name] for each in libraries]) for name in RECORDED}
    return FinishedLibrary(table, first.arrays | arrays)


def cells_of(table: pd.DataFrame) -> Iterator[AskedCell]:
    """Yield what each cell of library.csv was asked for."""
    columns = table.gait, table.speed_m_per_s, table.apex_m, table.stiffness_share
    for gait, speed, apex, share in zip(*columns, strict=True):
        yield asked_cell(gait, speed, apex, share)


def asked_cell(gait: str, *numbers: float) -> AskedCell:
    """numbers: speed, m/s, apex, m, and stiffness share."""
    speed, apex, share = (round(float(number), GOAL_DIGITS) for number in numbers)
    return AskedCell(str(gait), speed, apex, share)
