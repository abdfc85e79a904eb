"""What a sweep leaves when it ends, and how one that is started again goes on; with stages that take milliseconds."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

from romgrl.results.sweep_record import sweeps
from tests.helpers.jobs import Command, start, trainings
from tests.helpers.limits import PATIENCE

SWEEP = ("-m", "experiment=smoke", "stage=evaluation", "eta=0.3,0.5")


def counted(outputs: Path) -> Counter[str]:
    """How often each stage was made."""
    return Counter(line.split()[0] for line in trainings(outputs))


def test_a_sweep_goes_on_where_it_stopped_and_joins_its_jobs(command: Command, tmp_path: Path) -> None:
    outputs = tmp_path / "outputs"
    failed = command(*SWEEP, "tracking=none", FAKE_FAULT="evaluation:diverge")
    assert failed.returncode == 4
    first = counted(outputs)
    assert first == {"teacher": 1, "reference": 1, "student": 2, "baseline": 1, "evaluation": 2}
    table = next(outputs.glob("sweeps/*/results/table.md"))
    assert table.read_text(encoding="utf-8").count("evaluation: loss = nan at step 7") == 2
    assert "- eta=0.5: " in table.read_text(encoding="utf-8")

    again = command(*SWEEP)
    assert again.returncode == 0, again.stderr
    assert counted(outputs) - first == {"evaluation": 2}  # nothing was trained again
    sweep = sweeps(outputs)[-1]
    assert sweep.swept == ["eta"]
    cells = pd.read_csv(sweep.directory / "results" / "cells.csv")
    rows = cells[cells["number"] == "average/raw/reduction_percent"]
    assert rows[["eta", "seeds", "mean"]].to_numpy().tolist() == [[0.3, 1, 50.0], [0.5, 1, 50.0]]
    assert set(rows["note"]) == {"one seed, short budget"}
    stored = list(outputs.glob("mlartifacts/**/table.md"))  # of the parent run
    assert [path.read_text(encoding="utf-8") for path in stored] == [
        (sweep.directory / "results" / "table.md").read_text(encoding="utf-8")
    ]
    assert "| 0.3 | - | - | - | - | - | 50 |" in stored[0].read_text(encoding="utf-8")
    assert stored[0].with_name("jobs.csv").exists()


@pytest.mark.slow
def test_jobs_in_other_processes_are_joined_too(tmp_path: Path) -> None:
    process = start(
        *SWEEP, "hydra/launcher=joblib", "tracking=none", f"paths.outputs={tmp_path}", module="tests.helpers.fake_jobs"
    )
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert "sweep: tables and figures of all jobs: " in out
    jobs = pd.read_csv(next(tmp_path.glob("sweeps/*/results/jobs.csv")))
    assert jobs["ended"].tolist() == ["finished"] * 2
    assert jobs["eta"].tolist() == [0.3, 0.5]
    assert jobs["average/raw/reduction_percent"].tolist() == [50.0] * 2
