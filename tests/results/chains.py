"""Finished stages as manifests have them, with numbers of the test's own in the evaluation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path

import pandas as pd

from romgrl.artifacts import Manifest, write_manifest
from romgrl.config.schema import Config
from romgrl.gait.features import ALIGNMENTS, CHANNELS
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import stage_key, stage_settings
from romgrl.results.evaluation_index import LINEAGE

FLOOR, VARIANCE = 0.002, 0.05  # m^2
GAIT = {
    "episodes": 100,
    "falls": 0,
    "speed_error_percent": 1.0,
    "stride_frequency_hz": 1.5,
    "left_right_symmetry": 0.9,
    "touchdown_phase_strides": 0.45,
    "phase_lag_strides": 0.05,
    "steady_speed_m_per_s": 4.0,
    "trunk_lean_deg": 5.0,
}


def finish(
    outputs: Path,
    config: Config,
    *,
    student: float = 0.01,
    baseline: float = 0.1,
    gait: Mapping[str, float] | None = None,
    comparable: bool = True,
    revision: str = "a" * 40,
) -> Path:
    """Write all stages of a configuration, and the errors of student and baseline in m^2 in its evaluation."""
    made: dict[str, Manifest] = {}
    for stage in LINEAGE:
        inputs = {name: made[name].digest for name in STAGES[stage].upstream}
        key = stage_key(stage, config, inputs | {"revision": revision})
        directory = outputs / "artifacts" / stage / key
        directory.mkdir(parents=True, exist_ok=True)
        settings = json.loads(json.dumps(stage_settings(stage, config)))
        (directory / "content.txt").write_text(json.dumps([settings, inputs], sort_keys=True), encoding="utf-8")
        if stage == "evaluation":
            write_numbers(directory, student, baseline, gait or {}, comparable=comparable)
        made[stage] = write_manifest(
            directory,
            stage=stage,
            key=key,
            config=settings,
            inputs=inputs,
            versions={"python": "3.11"},
            revision=revision,
            dirty=False,
            seed=config.seed,
            wall_time=60.0,
        )
    return directory


def write_numbers(
    directory: Path, student: float, baseline: float, gait: Mapping[str, float], *, comparable: bool
) -> None:
    """mse.csv, gait.csv and null_models.csv, where an error is so many times the reference's variance, VARIANCE."""
    errors = {"baseline": baseline, "student": student, "reduction_percent": 100 * (1 - student / baseline)}
    errors["teacher_floor"] = FLOOR
    rows = [
        {"channel": channel, "alignment": alignment, **(errors if comparable else dict.fromkeys(errors, float("nan")))}
        for alignment in ALIGNMENTS
        for channel in (*CHANNELS, "average")
    ]
    pd.DataFrame(rows).to_csv(directory / "mse.csv", index=False)
    walkers = {"teacher": GAIT, "student": GAIT | dict(gait), "baseline": GAIT}
    pd.DataFrame([{"walker": name, **row} for name, row in walkers.items()]).to_csv(directory / "gait.csv", index=False)
    scores = [(walker, error / VARIANCE) for walker, error in errors.items() if walker in walkers]
    nulls = [
        {"walker": walker, "measure": "error_over_variance", "channel": channel, "value": value}
        for walker, value in [*scores, ("teacher", FLOOR / VARIANCE)]
        for channel in (*CHANNELS, "average")
    ]
    pd.DataFrame(nulls).to_csv(directory / "null_models.csv", index=False)


def changed(config: Config, *overrides: str) -> Config:
    """A configuration with other values, without the time that Hydra takes."""
    config = deepcopy(config)
    for override in overrides:
        key, _, text = override.partition("=")
        group, _, leaf = key.rpartition(".")
        section = getattr(config, group) if group else config
        setattr(section, leaf, type(getattr(section, leaf))(text))
    return config
