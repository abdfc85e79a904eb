"""A library of synthetic runs: strides of whole numbers of steps, the shorter the faster, and cells that fell."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.artifacts import save_arrays, write_manifest
from romgrl.gait.features import CHANNELS
from romgrl.report.library_cells import MEASURED_CELLS
from tests.helpers.synthetic_gait import DT, run

STEPS = 240  # of a cell, in two episodes
REASON = "the reference falls: in 2 of 2 episodes, limit 0"


def stride_steps(speed: float) -> int:
    """Control steps of a stride at a speed: 24 at 2 m/s, 16 at 4."""
    return round(32 - 4 * speed)


def synthetic_library(
    speeds: Sequence[float] = (2.0, 3.0, 4.0),
    shares: Sequence[float] = (0.7, 1.4),
    *,
    gaits: Sequence[str] = ("run",),
    fallen: Sequence[int] = (),
) -> tuple[pd.DataFrame, dict[str, NDArray[Any]]]:
    """library.csv and library.npz; `fallen`: numbers of cells that are refused and fell within 10 steps."""
    rows: list[dict[str, Any]] = []
    cells = []
    for number, (speed, share, gait) in enumerate(product(speeds, shares, gaits)):
        fit = number not in fallen
        reason = "" if fit else REASON
        at: dict[str, Any] = {"gait": gait, "speed_m_per_s": speed, "apex_m": 0.0, "stiffness_share": share}
        at |= {"fit": fit, "reason": reason}
        measures = {name: round(0.1 * place + speed + share, 3) for place, name in enumerate(MEASURED_CELLS)}
        measures |= {} if fit else {"multiplier": np.nan, "duty_factor": np.nan}
        feet = {"foot_radius_m": 0.07, "roll_over_radius_m": 0.0}
        rows.append({**at, **measures, "orbit": "stable", **feet, "teacher": f"a {gait} by ppo, seed 0"})
        cells.append(synthetic_cell(speed, share, STEPS if fit else 10))
    arrays = {name: np.stack([cell[name] for cell in cells]) for name in cells[0]}
    return pd.DataFrame(rows), arrays | {"dt": np.array(DT), "channels": np.array(CHANNELS)}


def write_library(
    directory: Path,
    table: pd.DataFrame,
    arrays: dict[str, NDArray[Any]],
    *,
    stage: str = "library",
    key: str = "fedcba9876543210",
    config: dict[str, Any] | None = None,
) -> str:
    """A finished library's table, arrays and manifest; returns its directory as text."""
    directory.mkdir(parents=True)
    table.to_csv(directory / "library.csv", index=False)
    save_arrays(directory / "library.npz", arrays)
    made_from: dict[str, Any] = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 3}
    write_manifest(directory, stage=stage, key=key, config=config or {}, wall_time=1.0, **made_from)
    return str(directory)


def synthetic_cell(speed: float, share: float, kept: int) -> dict[str, NDArray[Any]]:
    """What library.npz has of one cell: `kept` steps, then nothing."""
    features, contact = run(
        episodes=2, steps=STEPS // 2, frequency=1.0 / (DT * stride_steps(speed)), duty=0.3, height=0.85 + 0.05 * share
    )
    there = np.arange(STEPS) < kept
    return {
        "features": np.where(there[:, None], features.reshape(STEPS, 5), np.nan).astype(np.float32),
        "velocity": np.where(there, speed, np.nan).astype(np.float32),
        "contact": contact.reshape(STEPS, 2) & there[:, None],
        "episode": np.where(there, np.arange(STEPS) // (STEPS // 2), -1).astype(np.int32),
    }
