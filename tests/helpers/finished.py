"""The artifacts that a report is made from, as a finished run leaves them, from gaits with known numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from romgrl.artifacts import save_arrays, write_manifest
from romgrl.gait.alignment import mse_table
from romgrl.gait.distances import measure_distances
from romgrl.gait.features import Gait
from romgrl.gait.metrics import describe, stride_frequency
from romgrl.gait.null_models import null_models as make_null_models
from romgrl.gait.null_table import null_table

STAGES = ("teacher", "reference", "student", "baseline", "evaluation")


def write(folder: Path, gaits: Mapping[str, Gait], states: Mapping[str, Any], *, speed: float) -> dict[str, Path]:
    """A directory per stage. gaits: teacher, student, baseline; states (T, nq + nv) of the last two, recorded."""
    inputs = {name: folder / name for name in STAGES}
    for path in inputs.values():
        path.mkdir(parents=True)
    teacher, student, baseline = (gaits[name] for name in ("teacher", "student", "baseline"))
    compared = {"reference": teacher, "student": student, "baseline": baseline}
    episodes, steps = teacher.features.shape[:2]
    reference = {"features": teacher.features.reshape(-1, 5), "velocity": np.ravel(teacher.velocity), "dt": teacher.dt}
    reference |= {"episode": np.repeat(np.arange(episodes, dtype=np.int32), steps), "speed": speed}
    save_arrays(inputs["reference"] / "reference.npz", reference)
    rollouts: dict[str, Any] = {"dt": teacher.dt}
    for name in ("student", "baseline"):
        rollouts |= {f"{name}_features": gaits[name].features, f"{name}_upright": gaits[name].valid}
        rollouts |= {f"{name}_velocity": gaits[name].velocity, f"{name}_states": states[name]}
    save_arrays(inputs["evaluation"] / "rollouts.npz", rollouts)
    errors, distances = mse_table(**compared, window=100), measure_distances(**compared, window=100, seed=0)
    errors.to_csv(inputs["evaluation"] / "mse.csv", index=False)
    distances.to_csv(inputs["evaluation"] / "distances.csv", index=False)
    null_models(gaits, errors, distances).to_csv(inputs["evaluation"] / "null_models.csv", index=False)
    rows = [{"walker": name, **describe(gait, target_speed=speed)} for name, gait in gaits.items()]
    pd.DataFrame(rows).to_csv(inputs["evaluation"] / "gait.csv", index=False)
    return inputs


def null_models(gaits: Mapping[str, Gait], errors: pd.DataFrame, distances: pd.DataFrame) -> pd.DataFrame:
    """null_models.csv; there is no other teacher."""
    reference, rates = (
        gaits["teacher"].upright_episodes,
        {name: stride_frequency(gait.features, gait.dt, gait.valid) for name, gait in gaits.items()},
    )
    models, _ = make_null_models(reference, gaits["teacher"].dt, rates["teacher"], rates["student"], 100)
    return null_table(models, reference, errors=errors, distances=distances, window=100, seed=0)


def write_trainings(inputs: Mapping[str, Path], *, rows: int = 40) -> None:
    """curve.csv of the trainings, health.json of the student, and every manifest."""
    share = np.linspace(0.0, 1.0, rows)
    common = {"step": 4096 * np.arange(1, rows + 1), "speed": 4.0 * share}
    humanoid = common | {"episode_seconds": 10 * share, "fall_share": 1 - share, "trunk_lean_degrees": 20 - 25 * share}
    humanoid |= {"task_reward": share}
    judge = {f"discriminator_{key}": 1 - 0.3 * share for key in ("accuracy_teacher", "accuracy_student", "fit_loss")}
    judge |= {"discriminator_logit_teacher": 2 - share, "discriminator_logit_student": share - 2}
    judge |= {"discriminator_held_out_loss": 1 - 0.2 * share, "discriminator_feature_gap": 2 - share}
    pd.DataFrame(common | {"left_right_correlation": -share}).to_csv(inputs["teacher"] / "curve.csv", index=False)
    pd.DataFrame(humanoid).to_csv(inputs["baseline"] / "curve.csv", index=False)
    pd.DataFrame(humanoid | judge | {"imitation_reward": share}).to_csv(inputs["student"] / "curve.csv", index=False)
    spells = [{"name": "standing_still", "first_step": 20480, "last_step": 40960}]
    (inputs["student"] / "health.json").write_text(
        json.dumps({"verdict": "healthy", "now": [], "history": spells}), encoding="utf-8"
    )
    for stage, path in inputs.items():
        write_manifest(
            path,
            stage=stage,
            key="0123456789abcdef",
            config={"seed": 3, "speed": 4.0},
            inputs={},
            versions={"python": "3.11.7", "torch": "2.13.0"},
            revision="c0ffee" * 6 + "beef",
            dirty=False,
            seed=3,
            wall_time=75.0,
        )
