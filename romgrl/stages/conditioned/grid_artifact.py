"""What the evaluation of a student that follows commands has written, read again; a file fits, or ArtifactError."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from romgrl.artifacts import load_arrays
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.report.command_grid import GRID_COLUMNS, GridTables, with_falls_percent
from romgrl.stages.wiring.artifact_arrays import Arrays, check_number, read_table, require_arrays

RECORDED_CELL = {"features": (len(CHANNELS),), "velocity": (), "contact": (2,), "valid": ()}
"""Arrays of a cell and of the ramp, and the shape of a step of theirs; states have the model's."""
TRANSITION_COLUMNS = ("walker", "transition", "falls", "episodes")
SUMMARY = ("bars",)


def read_grid_tables(directory: Path) -> GridTables:
    """Its CSV files."""
    return GridTables(
        grid=with_falls_percent(read_table(directory / "grid.csv", GRID_COLUMNS)),
        confusion=read_confusion(directory / "confusion.csv"),
        mmd=read_matrix(directory / "mmd.csv"),
        transitions=read_table(directory / "transitions.csv", TRANSITION_COLUMNS),
        summary=read_summary(directory / "grid.json"),
    )


def read_confusion(path: Path) -> pd.DataFrame:
    """How many of the student's episodes are of which gait, by the gait asked for.

    What was obeyed is the diagonal; after it come the gaits that are seen and were not asked for.
    """
    table = read_table(path, ("walker", "asked"))
    counts = table[table.walker == "student"].drop(columns="walker").set_index("asked")
    others = [name for name in counts if name not in counts.index and counts[name].sum() > 0]
    return counts[[*counts.index, *others]]


def read_summary(path: Path) -> dict[str, Any]:
    """grid.json."""
    try:
        found: dict[str, Any] = json.loads(path.read_text("utf-8"))
        missing = [name for name in SUMMARY if name not in found]
    except (OSError, ValueError, TypeError) as error:
        raise ArtifactError(f"{path}: cannot be read: {type(error).__name__}: {error}") from error
    if missing:
        raise ArtifactError(f"{path}: no {', '.join(missing)}")
    return found


def read_matrix(path: Path) -> pd.DataFrame:
    """A table of numbers whose first column names its rows."""
    table = read_table(path, ())
    matrix = table.set_index(table.columns[0])
    if not all(kind.kind in "fiu" for kind in matrix.dtypes):
        raise ArtifactError(f"{path}: not a table of numbers")
    return matrix


def read_recordings(directory: Path, states: int, dt: float) -> Arrays:
    """recordings.npz of a humanoid whose states have so many entries, dt s apart."""
    path = directory / "recordings.npz"
    arrays = load_arrays(path)
    require_arrays(
        path, arrays, ("gaits", "dt", "cell_speed", "cell_gait", "cell_states", "ramp_states", "ramp_command")
    )
    check_number(path, arrays, "dt", dt)
    leading = {"cell": arrays["cell_states"].shape[:2], "ramp": arrays["ramp_states"].shape[:1]}
    for of, size in leading.items():
        needed = {f"{of}_{name}": (*size, *shape) for name, shape in RECORDED_CELL.items()}
        needed[f"{of}_states"] = (*size, states)
        require_arrays(path, arrays, list(needed))
        for name, shape in needed.items():
            if arrays[name].shape != shape:
                raise ArtifactError(f"{path}: {name} is {arrays[name].shape}; needed: {shape}")
    wanted = (len(arrays["ramp_states"]), 2 + len(arrays["gaits"]))
    if arrays["ramp_command"].shape != wanted or not np.isfinite(arrays["ramp_command"]).all():
        raise ArtifactError(f"{path}: ramp_command is {arrays['ramp_command'].shape}; needed: {wanted}, finite")
    return arrays
