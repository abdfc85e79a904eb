"""Arrays and tables of the artifacts that a stage reads: a file fits, or ArtifactError says what it has and needs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.artifacts import load_arrays
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS, POWERS, episode_bounds

Arrays = dict[str, NDArray[Any]]
WALKERS = ("student", "baseline")
TOLERANCE = 1e-4  # of numbers that were float64 when they were written
ERROR_COLUMNS = ("channel", "alignment", "baseline", "student", "reduction_percent", "teacher_floor", "note")
MEASURED = ("baseline", "student", "teacher_floor", "baseline_p", "student_p", "floor_p")
DISTANCE_COLUMNS = ("distance", "channel", *MEASURED, "unit", "note")
GAIT_COLUMNS = ("walker", "episodes", "falls", "steady_speed_m_per_s", "stride_frequency_hz", "trunk_lean_deg")


def read_reference(directory: Path, config: Config, *, steps: int = 1) -> Arrays:
    """reference.npz of the configured teacher at the humanoid's time step; an episode has at least `steps` steps."""
    path = directory / "reference.npz"
    arrays = load_arrays(path)
    require_arrays(path, arrays, ("features", "episode", "dt", "speed"))
    length = len(arrays["features"]) if arrays["features"].ndim else 0
    require_array(path, arrays, "features", np.float32, (length, len(CHANNELS)))
    require_array(path, arrays, "episode", np.int32, (length,))
    check_channels(path, arrays)
    check_number(path, arrays, "dt", 1.0 / config.humanoid.control_frequency)
    check_number(path, arrays, "speed", config.teacher.speed)
    for name in ("velocity", *POWERS):
        if name in arrays:
            require_array(path, arrays, name, np.float32, (length,))
    if "falls" in arrays:
        require_array(path, arrays, "falls", np.float32, ())
    if "contact" in arrays:
        require_array(path, arrays, "contact", np.bool_, (length, 2))
    longest = max((stop - start for start, stop in episode_bounds(arrays["episode"])), default=0) if length else 0
    if longest < steps:
        raise ArtifactError(f"{path}: the longest episode has {longest} steps; needed: {steps}")
    return arrays


def check_falls(path: Path, falls: float, episodes: int) -> None:
    """Raise ArtifactError unless so many of the episodes can have fallen."""
    if not (falls.is_integer() and 0 <= falls <= episodes):
        raise ArtifactError(f"{path}: falls {falls:g}; needed: a whole number from 0 to {episodes}")


def read_rollouts(directory: Path, config: Config, states: int) -> Arrays:
    """rollouts.npz of the configured evaluation; a state of the humanoid has `states` entries."""
    path = directory / "rollouts.npz"
    arrays = load_arrays(path)
    size = (config.evaluation.episodes, config.evaluation.steps)
    require_arrays(path, arrays, ("dt", *(f"{name}_states" for name in WALKERS)))
    for name in WALKERS:
        require_array(path, arrays, f"{name}_features", np.float32, (*size, len(CHANNELS)))
        require_array(path, arrays, f"{name}_upright", np.bool_, size)
        require_array(path, arrays, f"{name}_velocity", np.float32, size)
        length = len(arrays[f"{name}_states"]) if arrays[f"{name}_states"].ndim else 0
        require_array(path, arrays, f"{name}_states", np.float32, (max(1, length), states))
    check_channels(path, arrays)
    check_number(path, arrays, "dt", 1.0 / config.humanoid.control_frequency)
    return arrays


def read_table(path: Path, columns: Collection[str]) -> pd.DataFrame:
    """A CSV file that has at least these columns and a row."""
    try:
        table = pd.read_csv(path)
    except (FileNotFoundError, ValueError) as error:  # pandas' own errors are ValueErrors
        raise ArtifactError(f"{path}: cannot be read: {error}") from error
    missing = [name for name in columns if name not in table]
    if missing or table.empty:
        raise ArtifactError(f"{path}: no {'column ' + ', '.join(missing) if missing else 'rows'}")
    return table


def require_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], names: Sequence[str]) -> None:
    """Raise ArtifactError naming the arrays that a file lacks."""
    missing = [name for name in names if name not in arrays]
    if missing:
        raise ArtifactError(f"{path}: no array {', '.join(missing)}")


def require_array(path: Path, arrays: Arrays, name: str, dtype: type, shape: tuple[int, ...]) -> None:
    """Raise ArtifactError unless an array is there, has this dtype and shape, and only finite numbers."""
    require_arrays(path, arrays, [name])
    array = arrays[name]
    if array.dtype != dtype or array.shape != shape:
        needed = f"{np.dtype(dtype)} {shape}"
        raise ArtifactError(f"{path}: {name} is {array.dtype} {array.shape}; needed: {needed}")
    if not np.isfinite(array).all():
        raise ArtifactError(f"{path}: {name} holds numbers that are not finite")


def check_channels(path: Path, arrays: Arrays) -> None:
    """Raise ArtifactError where a file says that its features have another order than the contract."""
    if "channels" in arrays and arrays["channels"].tolist() != list(CHANNELS):
        found = ", ".join(map(str, np.ravel(arrays["channels"])))
        raise ArtifactError(f"{path}: channels {found}; needed: {', '.join(CHANNELS)}")


def check_number(path: Path, arrays: Arrays, name: str, needed: float) -> None:
    """Raise ArtifactError unless a file holds this number."""
    array = arrays[name]
    found = float(array) if array.ndim == 0 and array.dtype.kind in "fiu" else np.nan
    if not abs(found - needed) <= TOLERANCE * max(abs(needed), TOLERANCE):
        raise ArtifactError(f"{path}: {name} {found:.6g}; needed: {needed:.6g}")
