"""sweeps/fair.yaml: what stands in the student's place against the student, seed by seed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from romgrl.gait.features import CHANNELS
from romgrl.results import statistics
from romgrl.results.against_student import write_against_student
from romgrl.results.evaluation_index import FinishedEvaluation
from romgrl.results.sweep_cells import JobResult
from romgrl.results.sweep_record import JobEnd, Sweep

STUDENTS = [0.1, 0.2, 0.3, 0.2, 0.2]  # errors over variance of five seeds
RESETS = [1.1, 1.4, 1.7, 1.8, 2.0]
NEARER = [0.0, 0.3, 0.2, 0.3, 0.1]


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "RESAMPLES", 999)


class Seeded:
    """An evaluation of which only the seed is asked."""

    def __init__(self, seed: int) -> None:
        self.manifest = self
        self.seed = seed


def job(walker: str, seed: int, error: float, **more: str) -> JobResult:
    """A job whose walker has the same error in all channels, but ten times as much in the height of the pelvis."""
    numbers = {f"error_over_variance/{channel}/student": error for channel in (*CHANNELS, "average")}
    numbers["error_over_variance/pelvis_y/student"] = 10 * error
    numbers |= {f"error_over_variance/{channel}/baseline": 8.0 for channel in (*CHANNELS, "average")}
    numbers |= {"student/falls_percent": 2.0, "baseline/falls_percent": 4.0}
    evaluation: FinishedEvaluation = Seeded(seed)  # what of it is read
    return JobResult({"comparison": walker, "seed": str(seed), **more}, JobEnd([]), numbers, evaluation)


def jobs(walker: str, errors: list[float], first: int = 0, **more: str) -> list[JobResult]:
    """A job for each error, in seeds from the first one on."""
    return [job(walker, first + i, error, **more) for i, error in enumerate(errors)]


def said(found: list[JobResult], directory: Path, name: str = "fair") -> str:
    """The text about the jobs of a sweep."""
    sweep = Sweep(directory, name, "python", [], {}, 0.0, {})
    return "\n".join(write_against_student(sweep, found, directory))


def test_a_table_of_all_walkers_and_what_imitation_is_worth(tmp_path: Path) -> None:
    found = jobs("student", STUDENTS) + jobs("same_choice", RESETS) + jobs("no_trunk", NEARER)
    text = said(found, tmp_path)
    assert text.count("### In the student's place") == 1
    first, resets_row, nearer_row, baseline_row = (
        [cell.strip() for cell in line.strip("| ").split("|")]
        for line in text.splitlines()
        if "0, 1, 2, 3, 4 |" in line
    )
    assert first[0] == "student"
    assert first[2].startswith("0.2 [")
    assert first[3:5] == ["2 (pelvis height)", "2 [2, 2]"]
    assert resets_row[0] == "same_choice"
    assert resets_row[6:] == ["0.0312", "0.00397", "0.00397", "0 and 0", "0.0938"]  # the last: three rows, 3 / 32
    assert nearer_row[0] == "no_trunk"
    assert baseline_row[:2] == ["baseline", "0, 1, 2, 3, 4"]
    assert baseline_row[2:5] == ["8 [8, 8]", "8 (pelvis height)", "4 [4, 4]"]
    tables = pd.read_csv(tmp_path / "against_student.csv").set_index(["comparison", "channel"])
    resets = tables.loc["same_choice"]
    assert resets.p_paired.tolist() == [1 / 32] * 6  # 1 of 32 sign patterns
    assert resets.p_holm.tolist()[:5] == [5 / 32] * 5
    assert math.isnan(resets.p_holm.average)
    assert resets.walker.pelvis_y == pytest.approx(16)
    assert resets.difference.average == pytest.approx(-1.4)
    assert resets.low.average < -1.4 < resets.high.average
    assert resets.p_unpaired.tolist() == [1 / 252] * 6
    # their minus our errors: -1 1 -1 1 -1 tenths, a sum that all but the 6 patterns with at most one plus reach
    assert tables.p_paired[("no_trunk", "average")] == pytest.approx(26 / 32, abs=1e-3)
    sentence = text.splitlines()[-1]
    start = (
        "What the imitation alone is worth: the student's error over variance is 0.2, that of same_choice, which has"
    )
    assert sentence.startswith(
        f"{start} its resets, the same choice of the policy and no imitation, 1.6; difference by seed -1.4 [-1."
    )
    assert "exact one-sided p = 0.0312, 5 pairs of seeds 0, 1, 2, 3, 4 (chose the settings)." in sentence


def test_held_out_seeds_alone_and_no_verdict_of_few(tmp_path: Path) -> None:
    found = jobs("student", [9.0, 9.0, 0.1, 0.2], first=3) + jobs("same_choice", [1.0, 1.0, 1.1, 1.4], first=3)
    text = said(found, tmp_path)
    assert "student's error over variance is 0.15, " in text
    assert "difference by seed -1.1 (-1.2 to -1) (range in parentheses, too few seeds)" in text
    assert "p = 0.25, 2 pairs of seeds 5, 6 (held out)" in text


def test_no_sentence_where_one_is_missing(tmp_path: Path) -> None:
    text = said(jobs("student", STUDENTS) + jobs("no_trunk", NEARER), tmp_path)
    assert "| no_trunk |" in text
    assert "worth" not in text
    assert said(jobs("same_choice", RESETS) + jobs("no_trunk", NEARER), tmp_path) == ""
    assert "worth" not in said(jobs("student", STUDENTS), tmp_path)
    assert said(jobs("student", STUDENTS) + jobs("same_choice", RESETS), tmp_path, name="eta") == ""
    assert "worth" not in said(jobs("student", STUDENTS) + jobs("same_choice", [math.nan] * 5), tmp_path)


def test_what_the_model_is_worth_beside_cosines(tmp_path: Path) -> None:
    worse = [value + 0.1 for value in STUDENTS]
    text = said(jobs("student", STUDENTS) + jobs("sinusoid", worse), tmp_path)
    (sentence,) = [line for line in text.splitlines() if "is worth" in line]
    assert sentence.startswith("What the reduced-order model is worth beside cosines of its cadence and amplitudes: ")
    assert "difference by seed -0.1 [-0.1, -0.1]" in sentence
    assert "p = 0.0312, 5 pairs" in sentence


def test_a_walker_without_an_error_does_not_drop_out_silently(tmp_path: Path) -> None:
    """Means of common seeds, how many are without, and neither p nor sentence where the student is one of them."""
    lost = [math.nan, *STUDENTS[1:]]
    text = said(jobs("student", lost) + jobs("same_choice", RESETS), tmp_path)
    table = pd.read_csv(tmp_path / "against_student.csv").set_index(["comparison", "channel"])
    row = table.loc[("same_choice", "average")]
    assert (row.student_without, row.walker_without, row.pairs) == (1, 0, 4)
    assert math.isnan(row.p_paired)
    assert row.walker == pytest.approx(np.mean(RESETS[1:]))
    assert "worth" not in text
    text = said(jobs("student", STUDENTS) + jobs("same_choice", [math.nan, *RESETS[1:]]), tmp_path)
    assert "p = 0.0625, 4 pairs" in text


def test_other_swept_keys_stand_apart(tmp_path: Path) -> None:
    walk = [*jobs("default", STUDENTS, speed="1"), *jobs("same_choice", STUDENTS, speed="1")]
    run = [*jobs("default", STUDENTS, speed="4"), *jobs("same_choice", RESETS, speed="4")]
    text = said([*walk, *run], tmp_path)
    assert "### In the student's place, speed=1\n" in text
    assert "### In the student's place, speed=4\n" in text
    assert text.count("What the imitation alone is worth") == 2
