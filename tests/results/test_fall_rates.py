"""The robustness stages of a sweep together: means over seeds, the level that a student survives, curves, orbits."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from PIL import Image

from romgrl.artifacts import write_manifest
from romgrl.results.__main__ import main
from romgrl.results.sweep_record import JobEnd, note_end, write_sweep

RATES = {
    0: [0.0, 0.1, 0.9],
    1: [0.0, 0.3, 1.0],
    5: [0.0, 0.5, 1.0],
    6: [0.0, 0.8, 1.0],
    7: [0.9, 0.9, 1.0],
}  # of the students of seeds at three levels
SHARES = {"mass": [0.8, 1.2], "friction": [0.8, 1.2]}
MULTIPLIERS = {0: 0.4, 1: 1.1, 5: 0.5, 6: 0.4, 7: 0.4}


def disturbed(directory: Path, rates: int, seed: int | None = None) -> None:
    """A robustness artifact: the baseline always falls, the student as RATES say, never from another mass or ground."""
    directory.mkdir(parents=True)
    pushes = [
        ("push_forward", "N s/kg", level, rate) for level, rate in zip([0.0, 0.3, 0.6], RATES[rates], strict=True)
    ]
    others = [(name, "share", level, 0.0) for name, levels in SHARES.items() for level in levels]
    rows = [
        {"perturbation": name, "unit": unit, "level": level, "walker": walker, "trials": 100, "fall_rate": rate}
        for name, unit, level, student in pushes + others
        for walker, rate in (("student", student), ("baseline", 1.0))
    ]
    pd.DataFrame(rows).to_csv(directory / "robustness.csv", index=False)
    value = MULTIPLIERS[rates]
    orbit = {"rank": 1, "modulus": value, "low": value - 0.1, "high": value + 0.1}
    pd.DataFrame([orbit]).to_csv(directory / "floquet.csv", index=False)
    write_manifest(
        directory,
        stage="robustness",
        key=directory.name,
        config={"speed": 4.0},
        inputs={},
        versions={},
        revision=None,
        dirty=False,
        seed=rates if seed is None else seed,
        wall_time=1.0,
    )


@pytest.fixture
def outputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A sweep over two seeds whose jobs end with their robustness."""
    jobs = [[f"seed={seed}"] for seed in (0, 1)]
    write_sweep(
        tmp_path / "sweeps" / "a", "robustness", "python -m romgrl", jobs, machine={"cores": 2}, started=1.0, usual={}
    )
    for seed, job in enumerate(jobs):
        disturbed(tmp_path / "artifacts" / "robustness" / str(seed), seed)
        note_end(JobEnd(job, {"robustness": f"/elsewhere/robustness/{seed}"}))
    return tmp_path


def test_results_have_fall_rates_over_seeds(outputs: Path) -> None:
    docs = outputs / "docs"
    assert main([str(outputs), str(docs)]) == 0
    table = pd.read_csv(docs / "results" / "robustness_fall_rates.csv").set_index(["perturbation", "level", "walker"])
    row = table.loc[("push_forward", 0.3, "student")]
    assert (row.trials, row.fall_rate, row.low, row.high) == (200, pytest.approx(0.2), 0.1, 0.3)
    text = (docs / "results.md").read_text(encoding="utf-8")
    assert "Seeds 0, 1 (chose the settings):\n" in text
    assert "| push forward | 0.3 | N s/kg | 20 % (10 to 30) | 100 % |" in text  # at 0.6 most students fall
    assert "| mass | 0.8 | share | 0 % | 100 % |" in text
    assert "| mass | 1.2 | share | 0 % | 100 % |" in text
    assert "Largest Floquet multiplier of the teachers: 0.75 (0.40 to 1.10); below 1, so stable, in 1 of 2." in text
    assert "![robustness, fall_rates](results/robustness_fall_rates.png)" in text
    with Image.open(docs / "results" / "robustness_fall_rates.png") as picture:
        assert picture.width > 1000
    jobs = pd.read_csv(docs / "results" / "robustness_jobs.csv").set_index("seed")
    assert jobs.loc[1, "push_forward/0.3/student/fall_rate"] == 0.3


def test_held_out_seeds_are_drawn_alone(outputs: Path) -> None:
    disturbed(outputs / "artifacts" / "robustness" / "5", 5)
    sweep = outputs / "sweeps" / "a"
    write_sweep(sweep, "robustness", "python -m romgrl", [["seed=0"], ["seed=5"]], machine={}, started=1.0, usual={})
    note_end(JobEnd(["seed=5"], {"robustness": "/elsewhere/robustness/5"}))
    assert main([str(outputs), str(outputs / "docs")]) == 0
    table = pd.read_csv(outputs / "docs" / "results" / "robustness_fall_rates.csv")
    assert set(table.trials) == {100}  # of one seed
    text = (outputs / "docs" / "results.md").read_text(encoding="utf-8")
    held_out, chosen = text.index("Seed 5 (held out):"), text.index("Seed 0 (chose the settings):")
    assert "| push forward | 0.3 | N s/kg | 50 % | 100 % |" not in text[held_out:chosen]
    assert "| push forward | 0 | N s/kg | 0 % | 100 % |" in text[held_out:chosen]  # at 0.3 half of them fall
    assert "| push forward | 0.3 | N s/kg | 10 % | 100 % |" in text[chosen:]


def test_artifacts_that_are_gone_are_left_out(outputs: Path) -> None:
    (outputs / "artifacts" / "robustness" / "1").rename(outputs / "moved")
    assert main([str(outputs), str(outputs / "docs")]) == 0
    table = pd.read_csv(outputs / "docs" / "results" / "robustness_fall_rates.csv")
    assert set(table.trials) == {100}


def test_what_stands_in_the_students_place_is_another_walker(outputs: Path) -> None:
    """The baseline, which all of them share, is the one beside the student."""
    disturbed(outputs / "artifacts" / "robustness" / "same", 6, seed=0)
    jobs = [["comparison=student", "seed=0"], ["comparison=same_resets", "seed=0"]]
    write_sweep(outputs / "sweeps" / "a", "robustness", "", jobs, machine={}, started=1.0, usual={})
    for job, name in zip(jobs, ("0", "same"), strict=True):
        note_end(JobEnd(job, {"robustness": f"/elsewhere/robustness/{name}"}))
    assert main([str(outputs), str(outputs / "docs")]) == 0
    text = (outputs / "docs" / "results.md").read_text(encoding="utf-8")
    assert "| disturbance | level | unit | student | same_resets | baseline |" in text
    assert "| push forward | 0.3 | N s/kg | 10 % | 80 % | 100 % |" in text
    table = pd.read_csv(outputs / "docs" / "results" / "robustness_fall_rates.csv")
    assert set(table.trials) == {100}


def test_without_the_student_the_baseline_stays(outputs: Path) -> None:
    """And a sweep of one walker alone does not call it the student; one that always falls has a row, too."""
    disturbed(outputs / "artifacts" / "robustness" / "same", 7, seed=0)
    jobs = [["comparison=same_resets", "seed=0"]]
    write_sweep(outputs / "sweeps" / "a", "robustness", "", jobs, machine={}, started=1.0, usual={})
    note_end(JobEnd(jobs[0], {"robustness": "/elsewhere/robustness/same"}))
    assert main([str(outputs), str(outputs / "docs")]) == 0
    text = (outputs / "docs" / "results.md").read_text(encoding="utf-8")
    assert "| disturbance | level | unit | same_resets | baseline |" in text
    assert "| push forward | 0 | N s/kg | 90 % | 100 % |" in text
