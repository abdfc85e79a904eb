"""Evaluation: deterministic rollouts of student and baseline, scored against the reference (paper section 4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from romgrl.artifacts import save_arrays
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.alignment import aligned_phase_lag, error_over_variance, mse_table
from romgrl.gait.distances import measure_distances
from romgrl.gait.features import CHANNELS, Gait, gait_from_reference, gait_from_rollouts
from romgrl.gait.metrics import describe
from romgrl.gait.null_models import AVERAGE, OVER_VARIANCE, NullModel, null_models
from romgrl.gait.null_table import null_table
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.rollouts.humanoid import roll_out
from romgrl.stages.rollouts.other_teacher import other_teacher
from romgrl.stages.wiring.artifact_arrays import WALKERS, check_falls, read_reference
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.rom import rom_parameters
from romgrl.stages.wiring.seeds import EVALUATION_SEED
from romgrl.stages.wiring.walker_policy import read_walker


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write rollouts.npz, mse.csv, distances.csv, gait.csv and null_models.csv.

    Student and baseline start from the same states.
    """
    evaluation = config.evaluation
    reference = read_reference(inputs["reference"], config, steps=evaluation.window)
    check_falls(inputs["reference"] / "reference.npz", float(reference.get("falls", 0.0)), config.reference.episodes)
    env = humanoid_env(config, num_envs=evaluation.episodes, episode_steps=evaluation.steps + 1)
    policies = {name: read_walker(inputs[name], env) for name in WALKERS}
    total = len(WALKERS) * evaluation.steps
    rollouts: dict[str, Any] = {"dt": env.control_step, "channels": np.array(CHANNELS)}
    for index, name in enumerate(WALKERS):
        done = index * evaluation.steps
        arrays = roll_out(
            env,
            policies[name],
            steps=evaluation.steps,
            seed=config.seed + EVALUATION_SEED,
            progress=partial(_progress, log, done, total),
        )
        rollouts |= {f"{name}_{key}": value for key, value in arrays.items()}
    env.close()
    save_arrays(output / "rollouts.npz", rollouts)
    gaits = {"teacher": gait_from_reference(reference), **{n: gait_from_rollouts(rollouts, n) for n in WALKERS}}
    speeds = {"teacher": float(reference["speed"]), **dict.fromkeys(WALKERS, config.speed)}
    teacher, student, baseline = (gaits[name] for name in ("teacher", *WALKERS))
    compared = {"reference": teacher, "student": student, "baseline": baseline}
    errors = mse_table(**compared, window=evaluation.window)
    distances = measure_distances(**compared, window=evaluation.window, seed=config.seed)
    masses = {"teacher": rom_parameters(config).mass, **dict.fromkeys(WALKERS, env.dimensions.mass)}
    table = describe_walkers(gaits, speeds, masses, window=evaluation.window)
    if "falls" in reference:  # of the teacher's episodes, which count here as far as the reference holds them
        table.loc[table["walker"] == "teacher", "falls"] = int(reference["falls"])
    errors.to_csv(output / "mse.csv", index=False)
    distances.to_csv(output / "distances.csv", index=False)
    table.to_csv(output / "gait.csv", index=False)
    nulls = score_null_models(config, teacher, table, errors, distances, log)
    nulls.to_csv(output / "null_models.csv", index=False)
    log_summary(errors, table, log)
    log_null_models(nulls, log)


def score_null_models(
    config: Config, teacher: Gait, table: pd.DataFrame, errors: pd.DataFrame, distances: pd.DataFrame, log: StageLog
) -> pd.DataFrame:
    """null_models.csv beside gait.csv, mse.csv and distances.csv; says which rows there cannot be."""
    window, reference = config.evaluation.window, teacher.upright_episodes
    cadence, target = table.set_index("walker").stride_frequency_hz[["teacher", "student"]]
    models, absent = null_models(reference, teacher.dt, cadence, target, window)
    try:
        models["other_teacher"] = NullModel(other_teacher(config, reference))
    except ArtifactError as error:
        absent["other_teacher"] = str(error)
    for name, reason in absent.items():
        log.message(f"no null model {name}: {reason}")
    return null_table(models, reference, errors=errors, distances=distances, window=window, seed=config.seed)


def describe_walkers(
    gaits: Mapping[str, Gait], speeds: Mapping[str, float], masses: Mapping[str, float], *, window: int
) -> pd.DataFrame:
    """gait.csv: one row per walker, phase lag included; speeds, m/s, that they are to hold, and masses, kg."""
    rows = []
    for name, gait in gaits.items():
        seconds, strides = aligned_phase_lag(gait, gaits["teacher"], window)
        row = describe(gait, target_speed=speeds[name], mass=masses[name])
        error = error_over_variance(gait, gaits["teacher"], window)
        row |= {"error_over_variance": float(error.mean()), "largest_error_over_variance": float(error.max())}
        rows.append({"walker": name, **row, "phase_lag_s": seconds, "phase_lag_strides": strides})
    return pd.DataFrame(rows)


def _progress(log: StageLog, done: int, total: int, step: int) -> None:
    log.progress(done + step, total)


def log_summary(errors: pd.DataFrame, table: pd.DataFrame, log: StageLog) -> None:
    """One line per walker and one for the error."""
    rows = table.set_index("walker")
    for name in WALKERS:
        row = rows.loc[name]
        strides = "no strides" if np.isnan(row.stride_frequency_hz) else f"{row.stride_frequency_hz:.2f} strides/s"
        log.message(
            f"{name}: {row.episodes - row.falls:.0f} of {row.episodes:.0f} episodes upright, "
            f"{row.steady_speed_m_per_s:.2f} m/s, {strides}, "
            f"trunk lean {row.trunk_lean_deg:.0f} degrees"
        )
    average = errors[errors.channel == "average"].set_index("alignment")
    if errors.note.iloc[0] == "ok":
        percent = average.reduction_percent
        log.message(f"error against the teacher reduced by {percent.aligned:.1f} % (no shift: {percent.raw:.1f} %)")
    else:
        log.message(f"error against the teacher: {errors.note.iloc[0]}")


def log_null_models(nulls: pd.DataFrame, log: StageLog) -> None:
    """One line: what walkers that learned nothing score."""
    errors = nulls[(nulls.measure == OVER_VARIANCE) & (nulls.channel == AVERAGE)]
    told = ", ".join(f"{row.walker} {row.value:.2f}" for row in errors.itertuples())
    log.message(f"error over variance, one shift within one episode: {told}")
