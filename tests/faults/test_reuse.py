"""A sweep trains what its jobs share once, and MLflow shows what was reused and the time that it saved."""

from __future__ import annotations

from collections import Counter
from itertools import product
from pathlib import Path

import pytest
from mlflow.entities import Run

from romgrl.config.schema import STAGES
from tests.conftest import Command
from tests.helpers.jobs import trainings
from tests.helpers.tracked import all_runs

SPEEDS, ETAS, SEEDS = (1, 4), (0.3, 0.5), (0, 1)
JOBS = len(list(product(SPEEDS, ETAS, SEEDS)))
DISTINCT = {
    "teacher": len(SEEDS),
    "reference": len(SEEDS),
    "baseline": len(SPEEDS) * len(SEEDS),
    "student": JOBS,
    "evaluation": JOBS,
    "report": JOBS,
}


def sweep() -> list[str]:
    lists = {"speed": SPEEDS, "eta": ETAS, "seed": SEEDS}
    return ["-m", *(f"{key}={','.join(map(str, values))}" for key, values in lists.items())]


def reused(job: Run) -> dict[str, str]:
    """Stage -> MLflow run that a job took it from."""
    return dict(entry.split("=") for entry in job.data.tags.get("romgrl.reused_from", "").split())


@pytest.mark.slow
def test_sweep_counted_from_mlflow(command: Command, tmp_path: Path) -> None:
    result = command(*sweep(), "experiment=smoke", FAKE_SECONDS="0.05")
    assert result.returncode == 0, result.stderr
    runs = all_runs(tmp_path / "outputs")
    made = {run.info.run_id: run for run in runs if run.data.tags["stage"] in STAGES}
    counts = Counter(run.data.tags["stage"] for run in made.values())
    jobs = [run for run in runs if run.data.tags["stage"] == "job"]
    uses = Counter(stage for job in jobs for stage in reused(job))
    print(f"{JOBS} jobs: {dict(counts)}, reused {dict(uses)}")
    assert counts == DISTINCT
    assert len(jobs) == JOBS
    assert uses == {stage: JOBS - count for stage, count in DISTINCT.items() if count < JOBS}
    assert len(trainings(tmp_path / "outputs")) == sum(DISTINCT.values())
    for job in jobs:
        assert all(made[run].data.tags["stage"] == stage for stage, run in reused(job).items())
        saved = {stage: job.data.metrics[f"time_saved/{stage}"] for stage in reused(job)}
        assert all(seconds >= 0.05 for seconds in saved.values())
        assert job.data.metrics.get("time_saved", 0.0) == pytest.approx(sum(saved.values()))
