"""Evaluation of a student that follows commands, at every cell of its library and from one command to another."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from romgrl.artifacts import save_arrays
from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.config.commanded import conditioned_keys
from romgrl.config.schema import Config
from romgrl.gait.alignment import last_windows
from romgrl.gait.distances import scale_of
from romgrl.gait.features import Floats
from romgrl.gait.gait_classes import CLASSES, OF_NO_GAIT
from romgrl.gait.mmd import mmd_to_each
from romgrl.provenance.grid_episodes import EPISODE_SECONDS
from romgrl.report.specialists import read_specialist
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.asked_episodes import Arrays, TableRow, Walker, command_table
from romgrl.stages.conditioned.cells import read_command_cells
from romgrl.stages.conditioned.grid_cells import GridCells, walk_cells
from romgrl.stages.conditioned.grid_summary import grid_results, specialist_numbers, with_specialists
from romgrl.stages.conditioned.transitions import (
    AFTER,
    BEFORE,
    LEAD,
    RAMP_EPISODES,
    RAMP_SECONDS,
    asked_ramp,
    asked_transitions,
    walk_ramp,
    walk_transitions,
)
from romgrl.stages.wiring.artifact_arrays import WALKERS
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker

MOST_WINDOWS = 32
"""Of a walker and cell, that MMD compares: the time grows with the square."""
STANDARDISED = "windows in deviations of the reference of the row's own cell, bandwidth of its points"
KEPT_BY = "the policy was kept by checks from other resets than those of this evaluation"


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write grid.csv, confusion.csv, mmd.csv, transitions.csv, ramp.csv, recordings.npz and grid.json.

    Student and baseline start from the same states. Blocks of episodes that are finished survive an interruption.
    """
    window, episodes, kept = config.evaluation.window, config.evaluation.episodes, output / CHECKPOINT
    cells = read_command_cells(inputs["library"], config, span=window)
    grid = GridCells(cells, window)
    kept.mkdir(exist_ok=True)
    asked, ramp = (
        asked_transitions(cells, standing=conditioned_keys(config.student).standing_share > 0),
        asked_ramp(cells),
    )
    tick = ticker(log, len(WALKERS) * steps_of(config, grid.count, len(asked)))
    small = humanoid_env(config, num_envs=1, commands=command_table(cells.gaits, [grid.asked(0)], 1))
    rows: list[TableRow] = [row for cell in range(grid.count) for row in grid.reference_rows(cell)]
    steps: list[TableRow] = []
    bins: list[TableRow] = []
    recorded: dict[str, Arrays] = {}
    for name in WALKERS:
        walker = Walker(config, read_walker(inputs[name], small), cells.gaits, small.model, tick)
        own, recorded[name] = walk_cells(grid, name, walker, small.dimensions.mass, episodes, kept)
        rows += own
        steps += walk_transitions(cells, asked, name, walker, episodes, kept)
        own, on_ramp = walk_ramp(cells, ramp, name, walker, episodes, kept)
        bins += own
        recorded[name] |= {f"ramp_{key}": value for key, value in on_ramp.items()}
    small.close()
    specialists = [read_specialist(Path(place)) for place in config.evaluation.specialists or ()]
    table, counts = with_specialists(grid_table(rows), specialists), confusion(rows)
    mmd, own_mmd = mmd_matrix(grid, recorded["student"]), mmd_of_halves(grid)
    transitions, along = pd.DataFrame(steps), pd.DataFrame(bins)
    table.to_csv(output / "grid.csv", index=False)
    counts.to_csv(output / "confusion.csv", index=False)
    pd.DataFrame(mmd, index=grid.names, columns=grid.names).rename_axis("student").to_csv(output / "mmd.csv")
    transitions.to_csv(output / "transitions.csv", index=False)
    along.to_csv(output / "ramp.csv", index=False)
    save_arrays(output / "recordings.npz", recordings(grid, recorded["student"]))
    found = grid_results(grid, table, {"student": mmd, "teacher": own_mmd}, transitions, along, ramp) | {
        "mmd": STANDARDISED,
        "kept_by": KEPT_BY,
    }
    found["specialists"] = specialist_numbers(specialists)
    (output / "grid.json").write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    log.message(f"{found['reached']} of {len(found['bars'])} bars reached; {KEPT_BY}")


def steps_of(config: Config, cells: int, transitions: int) -> int:
    """Control steps that a walker makes in all episodes."""
    episodes, rate = config.evaluation.episodes, config.humanoid.control_frequency
    seconds = episodes * (cells * EPISODE_SECONDS + transitions * (BEFORE + AFTER))
    return round(rate * (seconds + min(episodes, RAMP_EPISODES) * (LEAD + RAMP_SECONDS)))


def ticker(log: StageLog, total: int) -> Callable[[int], None]:
    """What is called with numbers of steps, and shows all that were made."""
    done = [0]

    def tick(steps: int) -> None:
        done[0] += steps
        log.progress(min(done[0], total), total)

    return tick


def grid_table(rows: list[TableRow]) -> pd.DataFrame:
    """grid.csv: walkers in the order of WALKERS, then reference and null models; cells in their order."""
    table = pd.DataFrame([{name: value for name, value in row.items() if name != "counts"} for row in rows])
    order = {name: place for place, name in enumerate((*WALKERS, "teacher", "sinusoid", "statue"))}
    return table.sort_values("walker", key=lambda names: names.map(order), kind="stable").reset_index(drop=True)


def confusion(rows: list[TableRow]) -> pd.DataFrame:
    """confusion.csv: of each walker and gait asked for, how many episodes are of which gait."""
    counted = [{"walker": row["walker"], "asked": row["gait"], **row["counts"]} for row in rows if "counts" in row]
    table = pd.DataFrame(counted).groupby(["walker", "asked"], sort=False)[[*CLASSES, OF_NO_GAIT]].sum().reset_index()
    order = {name: place for place, name in enumerate((*WALKERS, "teacher"))}
    return table.sort_values("walker", key=lambda names: names.map(order), kind="stable")


def mmd_matrix(grid: GridCells, recorded: Arrays) -> Floats:
    """MMD^2 of the walker at each cell (rows) from the reference at each (columns), STANDARDISED for the whole row."""
    references = [grid.cells.teacher(cell).upright_episodes for cell in range(grid.count)]
    pairs = zip(recorded["features"], recorded["upright"], strict=True)
    return matrix_of([grid.windows(*pair)[:MOST_WINDOWS] for pair in pairs], references, grid.window)


def mmd_of_halves(grid: GridCells) -> Floats:
    """The same of one half of each reference's episodes from the other halves: whether cells can be told apart."""
    references = [grid.cells.teacher(cell).upright_episodes for cell in range(grid.count)]
    first = [last_windows(episodes[0::2], grid.window) for episodes in references]
    return matrix_of(first, [episodes[1::2] or episodes for episodes in references], grid.window)


def matrix_of(walker: list[Floats], references: list[list[Floats]], window: int) -> Floats:
    """MMD^2 (C, C) of windows (E, W, 5) of each cell from the episodes of each reference."""
    compared, rows = [last_windows(episodes, window) for episodes in references], []
    for windows, reference in zip(walker, references, strict=True):
        scale = scale_of(reference, window)
        others = [scale.standardised(each) for each in compared]
        rows.append(mmd_to_each(scale.standardised(windows), others, scale.bandwidth))
    return np.stack(rows)


def recordings(grid: GridCells, recorded: Arrays) -> Arrays:
    """recordings.npz: an episode of the student at each cell and on the ramp."""
    cells = {
        f"cell_{name.removeprefix('recorded_')}": recorded[name] for name in recorded if name.startswith("recorded_")
    }
    ramp = {name: values for name, values in recorded.items() if name.startswith("ramp_")}
    about = {"speed": grid.cells.speed, "gait": grid.cells.gait}
    named = {"gaits": np.array(grid.cells.gaits), "dt": np.array(grid.cells.dt)}
    return cells | {f"cell_{name}": values for name, values in about.items()} | ramp | named
