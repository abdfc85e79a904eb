"""A job knows its place in a sweep, however many there are, from one reading of what was asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.results import sweep_record
from romgrl.results.sweep_record import SWEEP_VARIABLE, position, write_sweep


def test_the_places_of_a_sweep_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SWEEP_VARIABLE, "")
    jobs = [[f"seed={seed}", "stage=teacher"] for seed in range(200)]
    write_sweep(tmp_path, "config", "", [*jobs, ["seed=7"]], machine={}, started=0.0, usual={})
    read, whole = [], sweep_record.read_sweep
    monkeypatch.setattr(sweep_record, "read_sweep", lambda directory: (read.append(directory), whole(directory))[1])
    assert [position(job) for job in jobs] == [(place, 201) for place in range(1, 201)]
    assert position(["seed=200"]) is None
    assert read == [tmp_path]
    write_sweep(tmp_path / "other", "config", "", jobs[5:7], machine={}, started=0.0, usual={})
    assert position(jobs[6]) == (2, 2)
    (tmp_path / "other" / "sweep.json").unlink()
    assert position(jobs[6]) is None
