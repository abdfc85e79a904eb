"""Library: references of one teacher over its speeds and stiffnesses, each checked and measured (`stage=library`)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.artifacts import load_arrays, save_arrays
from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.config.commanded import USUAL_STIFFNESS
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS, Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.load_metrics import force_valley, net_extension, peak_force
from romgrl.gait.metrics import GRAVITY, describe
from romgrl.gait.reference_check import check_reference
from romgrl.provenance.library_grid import library_cells
from romgrl.report.finished_library import FinishedLibrary, joined_library, read_library
from romgrl.report.gait_atlas import gait_atlas
from romgrl.report.page.library_page import write_library_page
from romgrl.report.style import save
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.rollouts.orbital_stability import teacher_multipliers
from romgrl.stages.rollouts.teacher import roll_out_as_asked
from romgrl.stages.wiring.jumps_asked import jumps_asked
from romgrl.stages.wiring.rom import drawn_feet, rom_parameters
from romgrl.stages.wiring.teacher_strides import teacher_strides

Cell = dict[str, NDArray[Any]]

LARGEST_SPEED_ERROR, LEAST_SPEED_LIMIT = 0.05, 0.05
"""A cell's reference holds its speed within this share of it, or within so many m/s where that is more."""
LARGEST_APEX_ERROR = 0.03
"""Mean distance of its jumps' apexes from the one asked for, m."""


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write library.csv, a row for each cell, refused ones with the reason, gait_atlas, report.html and library.npz.

    library.npz: features (C, T, 5) m, episode (C, T), contact (C, T, 2) and velocity (C, T) m/s of `reference.steps`
    steps, nan and -1 where an episode fell before; dt s. The cells of `library.others` come last. A cell that is
    finished survives an interruption.
    """
    dt = 1.0 / config.humanoid.control_frequency
    others = [read_library(Path(place), steps=config.reference.steps, dt=dt) for place in config.library.others or ()]
    cells = library_cells(config)
    kept = output / CHECKPOINT
    kept.mkdir(exist_ok=True)
    rows, arrays = [], []
    for number, at in enumerate(cells):
        found = finished_cell(kept / f"cell_{number:04d}.npz", at)
        if found is None:
            found = make_cell(at, inputs["teacher"])
            save_arrays(kept / f"cell_{number:04d}.npz", found)
            tell_unfit(json.loads(str(found["row"])), log)
        row = json.loads(str(found.pop("row")))
        rows.append(row)
        arrays.append(found)
        log.progress(number + 1, len(cells), speed=row["speed_m_per_s"], fit=sum(row["fit"] for row in rows))
    names: Cell = {"channels": np.array(CHANNELS), "dt": np.array(dt)}
    own = {name: np.stack([each[name] for each in arrays]) for name in arrays[0]} | names
    how = f"a {config.teacher.gait} by {config.teacher.algorithm} on {config.rom.model}, seed {config.seed}"
    feet = {f"{name}_m": size for name, size in drawn_feet(config).items()}
    table = pd.DataFrame(rows).assign(**feet, teacher=f"{how}, artifact {inputs['teacher'].name}")
    library = joined_library(FinishedLibrary(table, own), others)
    library.table.to_csv(output / "library.csv", index=False)
    save_arrays(output / "library.npz", library.arrays)
    save(gait_atlas(library.table), output, "gait_atlas")
    write_library_page(output / "report.html", library.table, library.arrays)
    log.message(f"{int(library.table.fit.sum())} of {len(library.table)} cells are fit to be imitated")


def tell_unfit(row: Mapping[str, Any], log: StageLog) -> None:
    """Say of a cell that a conditioned student could be taught, and is not fit, why."""
    if not row["fit"] and row["stiffness_share"] == USUAL_STIFFNESS and not row["apex_m"]:
        log.message(f"{row['gait']} at {row['speed_m_per_s']:g} m/s is not fit to be imitated: {row['reason']}")


def finished_cell(path: Path, config: Config) -> Cell | None:
    """What an interrupted attempt left of a cell; None where there is nothing, nothing whole, or another cell."""
    try:
        found = load_arrays(path) if path.is_file() else {}
    except ArtifactError:
        found = {}
    row = json.loads(str(found["row"])) if "row" in found else {}
    return found if asked_of(config).items() <= row.items() else None


def asked_of(config: Config) -> dict[str, Any]:
    """What a cell is asked for: how its row begins."""
    teacher = config.teacher
    return {
        "gait": teacher.gait,
        "speed_m_per_s": teacher.speed,
        "stiffness_share": teacher.stiffness_share,
        "apex_m": teacher.apex,
    }


def make_cell(config: Config, teacher: Path) -> Cell:
    """The reference of a cell, and its row of the table as JSON."""
    gait, told = roll_out_as_asked(teacher, config)
    assert gait.velocity is not None
    assert gait.contact is not None
    row = cell_row(config, gait, told, teacher)
    steps, valid = config.reference.steps, gait.valid
    arrays = {
        "features": filled(gait.features[valid], steps, np.nan),
        "velocity": filled(gait.velocity[valid], steps, np.nan),
        "contact": filled(gait.contact[valid], steps, False),
        "episode": filled(np.nonzero(valid)[0].astype(np.int32), steps, -1),
    }
    return arrays | {"row": np.array(json.dumps(row))}


def filled(values: NDArray[Any], steps: int, missing: Any) -> NDArray[Any]:
    """The first `steps` of values (N, ...); what lacks is `missing`."""
    whole = np.full((steps, *values.shape[1:]), missing, values.dtype)
    whole[: len(values)] = values[:steps]
    return whole


def check_speed(asked: float, held: float) -> None:
    """ArtifactError for a reference of another speed than its cell's, m/s: a student of it would be paid for both."""
    limit = max(LARGEST_SPEED_ERROR * asked, LEAST_SPEED_LIMIT)
    if not abs(held - asked) <= limit:
        raise ArtifactError(f"the reference holds {held:.2f} m/s: off by more than {limit:.2f}")


def check_apexes(row: Mapping[str, float]) -> None:
    """ArtifactError for jumps that miss the apex asked for, or none; row: with `romgrl.gait.jumps.JUMP_MEASURES`."""
    if "jumps" in row and not row["jump_apex_error_m"] <= LARGEST_APEX_ERROR:
        told = f"{row['jumps']:.0f} jumps, {row['jump_apex_error_m']:.3f} m from the apex that was asked for"
        raise ArtifactError(f"the reference misses: {told}, limit {LARGEST_APEX_ERROR}")


def cell_row(config: Config, gait: Gait, told: Config, teacher: Path) -> dict[str, Any]:
    """A row of library.csv; `told`: the configuration that the teacher was told for this cell."""
    parameters, footfall = rom_parameters(config), FOOTFALLS[config.teacher.gait]
    row = asked_of(config) | {
        "told_speed_m_per_s": told.teacher.speed,
        "told_apex_m": told.teacher.apex,
        "fit": True,
        "reason": "",
    }
    row |= describe(gait, target_speed=config.teacher.speed, mass=parameters.mass, hops=footfall.together)
    row |= jumps_asked(config, gait, parameters)
    try:
        check_reference(gait, footfall)
        check_speed(config.teacher.speed, row["steady_speed_m_per_s"])
        check_apexes(row)
    except ArtifactError as error:
        row |= {"fit": False, "reason": str(error)}
    weight = parameters.mass * GRAVITY
    force = math.nan if gait.ground_force is None else peak_force(gait.ground_force, gait.valid)
    row["peak_force_body_weights"] = force / weight
    row["force_valley"] = math.nan if gait.ground_force is None else force_valley(gait.ground_force, gait.valid)
    row["net_extension_m"] = (
        math.nan if gait.contact is None else net_extension(gait.features, gait.contact, gait.valid)
    )
    metres = max(row["steady_speed_m_per_s"], 0.1) if config.teacher.speed else math.nan  # none is asked on the spot
    row["positive_work_j_per_kg_m"] = row["positive_power_w_per_kg"] / metres
    strides = teacher_strides(told, teacher)
    if strides is not None:
        last = teacher_multipliers(strides, config.library.orbit_worlds, config.seed).query("rank == 1").iloc[-1]
        row |= {
            f"multiplier{name}": float(last[of]) for name, of in {"": "modulus", "_low": "low", "_high": "high"}.items()
        }
        row["orbit"] = str(last.verdict)
    return row
