"""The evaluation of a student that follows commands, with known numbers: runs, walks, one fall and a ramp."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from romgrl.artifacts import save_arrays, write_manifest
from romgrl.humanoid.model import build
from tests.helpers.commanded import small_library
from tests.helpers.swinging import swinging
from tests.helpers.synthetic_gait import DT, run
from tests.helpers.synthetic_library import stride_steps

CELLS = (("run", 2.0), ("run", 3.0), ("run", 4.0), ("walk", 1.0), ("walk", 2.0))
FALLS = 2
"""The cell, at 4 m/s, in which the student falls after FALL_STEP steps."""
STEPS, RAMP_STEPS, FALL_STEP = 200, 1800, 70
ERRORS = (0.1, 0.2, np.nan, 0.3, 0.4)
SUMMARY = {
    "bars": [
        {"name": "speed_held_percent", "meaning": "cells whose speed is held", "way": "at least", "bar": 90.0}
        | {"reached": False, "student": 80.0, "baseline": 0.0, "teacher": 100.0},
        {"name": "error_over_specialist", "meaning": "error over a specialist's", "way": "at most", "bar": 1.5}
        | {"reached": None, "student": None, "baseline": None, "teacher": None},
        {"name": "mmd_diagonal_percent", "meaning": "cells nearest to their own", "way": "at least", "bar": 70.0}
        | {"reached": True, "student": 80.0},
    ],
    "cost_of_transport": {"student": {"run": {"is_u": False}, "walk": {"is_u": False}}},
    "ramp": {"student": {"switch_up_m_per_s": 2.1, "switch_down_m_per_s": 1.9}},
}
DUTY = {"run": 0.3, "walk": 0.62}


def write_grid(folder: Path, *, held_out: bool = True, ramp_falls_at: int | None = None) -> dict[str, Path]:
    """A directory for each stage that a report reads."""
    inputs = {name: folder / name for name in ("student", "baseline", "evaluation")}
    for path in inputs.values():
        path.mkdir(parents=True)
    inputs["library"] = small_library(folder / "library")
    write_tables(inputs["evaluation"], held_out=held_out)
    save_arrays(inputs["evaluation"] / "recordings.npz", recordings(ramp_falls_at))
    for stage in ("student", "baseline", "evaluation"):
        made: dict[str, Any] = {
            "inputs": {},
            "versions": {"python": "3.11"},
            "revision": None,
            "dirty": None,
            "seed": 3,
        }
        write_manifest(inputs[stage], stage=stage, key="0123456789abcdef", config={"seed": 3}, wall_time=75.0, **made)
    return inputs


def write_tables(directory: Path, *, held_out: bool) -> None:
    """The CSV files; the speeds between are held out, or none."""
    rows = []
    for walker in ("student", "baseline", "teacher"):
        for number, (gait, speed) in enumerate(CELLS):
            fell = walker == "student" and number == FALLS
            error = ERRORS[number] * {"student": 1.0, "baseline": 10.0, "teacher": 0.1}[walker]
            off = 0.6 if fell else {"student": 0.02, "baseline": -0.2, "teacher": 0.0}[walker]
            rows.append(
                {
                    "walker": walker,
                    "gait": gait,
                    "speed_m_per_s": speed,
                    "taught": not (held_out and speed == 3.0),
                    "episodes": 8,
                    "falls": 8 if fell else 0,
                    "steady_speed_m_per_s": speed + off,
                    "speed_error_m_per_s": off,
                    "speed_held": not fell and abs(off) <= max(0.1, 0.05 * speed),
                    "error_over_variance": error,
                    "stride_frequency_hz": 1.0 / (DT * stride_steps(speed)),
                    "duty_factor": DUTY[gait] - 0.02 * speed,
                    "pelvis_excursion_m": 0.04 + 0.01 * speed,
                    "touchdown_phase_strides": 0.5,
                    "cost_of_transport": 0.2 + 0.1 * (speed - 1.5) ** 2,
                }
            )
    for name, error in (("statue", 0.98), ("sinusoid", 0.3)):
        for gait, speed in CELLS:
            at = {"walker": name, "gait": gait, "speed_m_per_s": speed, "taught": True, "error_over_variance": error}
            rows.append({**at, "episodes": 8, "falls": 0, "speed_held": False, "steady_speed_m_per_s": np.nan})
    pd.DataFrame(rows).to_csv(directory / "grid.csv", index=False)
    names = [f"{gait} {speed:g}" for gait, speed in CELLS]
    distance = np.abs(np.subtract.outer(np.arange(5.0), np.arange(5.0))) * 0.2 + 0.05
    distance[1, 0] = 0.01  # nearer to another than to its own
    pd.DataFrame(distance, index=names, columns=names).to_csv(directory / "mmd.csv", index_label="student")
    write_counts(directory)
    (directory / "grid.json").write_text(json.dumps(SUMMARY), encoding="utf-8")


def write_counts(directory: Path) -> None:
    """confusion.csv and transitions.csv."""
    seen = {"walker": ["student", "student", "baseline", "baseline"], "asked": ["run", "walk"] * 2}
    seen |= {"walk": [0, 15, 0, 16], "run": [16, 1, 24, 0], "hop": [0] * 4, "skip": [0] * 4, "none": [8, 0, 0, 0]}
    pd.DataFrame(seen).to_csv(directory / "confusion.csv", index=False)
    rows = [
        {
            "walker": walker,
            "transition": transition,
            "from_gait": "run",
            "episodes": 8,
            "falls": falls,
            "settled": 8 - falls,
            "settling_time_s": 1.25 if settles else np.nan,
            "overshoot_m_per_s": 0.1,
            "obeyed_gait": 1.0,
        }
        for walker in ("student", "baseline")
        for transition, falls, settles in (("run 2 -> run 4", 1, True), ("walk 2 -> run 2", 0, False))
    ]
    pd.DataFrame(rows).to_csv(directory / "transitions.csv", index=False)


def recordings(ramp_falls_at: int | None = None) -> dict[str, Any]:
    """recordings.npz."""
    model = build()
    cells = [recorded_cell(model, gait, speed) for gait, speed in CELLS]
    arrays = {f"cell_{name}": np.stack([cell[name] for cell in cells]) for name in cells[0]}
    arrays["cell_valid"][FALLS, FALL_STEP:] = False
    arrays |= {"cell_speed": np.array([speed for _, speed in CELLS])}
    arrays |= {
        "cell_gait": np.array([("run", "walk").index(gait) for gait, _ in CELLS]),
        "gaits": np.array(["run", "walk"]),
    }
    ramp = recorded_ramp(model)
    if ramp_falls_at is not None:
        ramp["valid"][ramp_falls_at:] = False
    return arrays | {f"ramp_{name}": value for name, value in ramp.items()} | {"dt": np.array(DT)}


def recorded_cell(model: Any, gait: str, speed: float) -> dict[str, Any]:
    """A walker that strides as the library's cell does."""
    rate = 1.0 / (DT * stride_steps(speed))
    features, contact = run(episodes=1, steps=STEPS, frequency=rate, duty=DUTY[gait])
    time = DT * np.arange(STEPS)
    return {
        "states": swinging(model, rate * time, speed * time).astype(np.float32),
        "features": features[0].astype(np.float32),
        "velocity": np.full(STEPS, speed, np.float32),
        "contact": contact[0],
        "valid": np.ones(STEPS, bool),
    }


def recorded_ramp(model: Any) -> dict[str, Any]:
    """From 0.5 to 5 m/s and back in 60 s, at once: a walk below 2 m/s, a run above."""
    time = DT * np.arange(RAMP_STEPS)
    speed = 0.5 + 4.5 * (1.0 - np.abs(time / 30.0 - 1.0))
    walks = speed < 2.0
    phase = np.cumsum(DT * (0.6 + 0.25 * speed))
    duty = np.where(walks, 0.62, 0.35)
    contact = np.stack([phase % 1.0 < duty, (phase - 0.5) % 1.0 < duty], axis=-1)
    features, _ = run(episodes=1, steps=RAMP_STEPS, frequency=1.3)
    command = np.stack([speed, ~walks, walks, np.ones(RAMP_STEPS)], axis=1)
    return {
        "states": swinging(model, phase, np.cumsum(DT * speed)).astype(np.float32),
        "features": features[0].astype(np.float32),
        "velocity": speed.astype(np.float32),
        "contact": contact,
        "valid": np.ones(RAMP_STEPS, bool),
        "command": command.astype(np.float32),
    }
