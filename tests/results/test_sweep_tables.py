"""The joint tables and figures of sweeps, from jobs with numbers of the test's own."""

from __future__ import annotations

import math
import os
from itertools import product
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from romgrl.config.schema import Config
from romgrl.report.grid_tables import BARS
from romgrl.results import statistics, sweep_cells, sweep_tables
from romgrl.results.sweep_cells import JobResult, cells_table, headline_jobs, jobs_table, results
from romgrl.results.sweep_figures import figures
from romgrl.results.sweep_record import (
    SWEEP_VARIABLE,
    UNFINISHED,
    JobEnd,
    Sweep,
    note_end,
    position,
    read_sweep,
    settings,
    sweeps,
    write_sweep,
)
from romgrl.results.sweep_tables import joint_table, write_joint
from tests.results.chains import changed, finish


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "RESAMPLES", 999)
    monkeypatch.setattr(sweep_tables, "save_figures", lambda *arguments: None)


def swept(
    outputs: Path, config: Config, values: dict[str, list[str]], fail: str = "none", baseline: float = 0.1
) -> Sweep:
    """A sweep of finished jobs; the one with the overrides `fail` failed, and one that begins so did not end."""
    jobs = [[f"{k}={v}" for k, v in zip(values, each, strict=True)] for each in product(*values.values())]
    directory = outputs / "sweeps" / "2030-01-01"
    usual = {"student.total_steps": float(config.student.total_steps)}
    write_sweep(directory, "made", "python -m romgrl", jobs, machine={"cores": 2}, started=1.0, usual=usual)
    for job in jobs:
        own = changed(config, *job)
        if " ".join(job) == fail:
            note_end(JobEnd(job, error="student: loss = nan at step 7", seconds=3.0))
        elif not " ".join(job).startswith(f"{fail} but lost"):
            student = 0.01 + 0.02 * own.eta + 0.001 * own.seed
            evaluation = finish(outputs, own, student=student, baseline=baseline + 0.01 * own.seed)
            note_end(JobEnd([*job, "threads=1"], {"evaluation": f"/elsewhere/evaluation/{evaluation.name}"}))
    return read_sweep(directory)


def test_a_row_per_cell_with_its_statistics(default_config: Config, tmp_path: Path) -> None:
    sweep = swept(tmp_path, default_config, {"eta": ["0.3", "0.7"], "seed": ["0", "1", "2"]}, fail="eta=0.7 seed=1")
    directory = write_joint(sweep, tmp_path)
    jobs = pd.read_csv(directory / "jobs.csv")
    assert jobs["seed"].tolist() == [0, 1, 2] * 2
    assert jobs["ended"].tolist() == ["finished"] * 4 + ["student: loss = nan at step 7", "finished"]
    assert jobs["training_minutes"].dropna().tolist() == [5.0] * 5  # five stages of a minute
    cells = pd.read_csv(directory / "cells.csv").set_index(["eta", "number"])
    error = cells.loc[(0.3, "average/aligned/student")]
    assert (error["seeds"], error["without"]) == (3, 0)
    assert error["mean"] == pytest.approx(0.017)
    assert (error["smallest"], error["largest"]) == pytest.approx((0.016, 0.018))
    assert math.isnan(error["low"])  # three seeds have no interval
    assert error["improvement"] == 1.0  # every student below every baseline
    assert math.isnan(error["improvement_low"])
    assert (error["paired_p"], error["unpaired_p"]) == pytest.approx((1 / 8, 1 / 20))
    assert (error["note"], error["group"]) == ("too few seeds", "chose the settings")
    assert cells.loc[(0.3, "error_over_variance/pelvis_y/student"), "mean"] == pytest.approx(0.017 / 0.05)
    assert cells.loc[(0.3, "student/touchdown_asymmetry_strides"), "mean"] == pytest.approx(0.05)
    assert cells.loc[(0.7, "average/aligned/student"), "seeds"] == 2
    text = (directory / "table.md").read_text(encoding="utf-8")
    assert "- eta=0.7 seed=1: student: loss = nan at step 7" in text
    row = next(line for line in text.splitlines() if line.startswith("| 0.3 |"))
    assert "| 84.5 (84 to 85) |" in row  # 1 - 0.016 / 0.1, 0.017 / 0.11 and 0.018 / 0.12
    assert row.endswith("| 1 | 0.125 | 3 | too few seeds |")
    assert "Students of seeds 0, 1, 2 (chose the settings); [ ] the 95 % interval" in text


def test_libraries_and_grids_have_columns_of_their_own() -> None:
    numbers = {"library/cells": 39.0, "library/fit_percent": 50.0, "teacher/falls_percent": 1.0}
    grid = {"grid/speed_held_percent/student": 88.0, "grid/cadence_spearman/student": 0.9}
    for own, head in (
        (numbers, ["falls [%]", "cells", "fit cells [%]"]),
        (grid, [BARS["speed_held_percent"][2], BARS["cadence_spearman"][2]]),
    ):
        job = JobResult({"seed": "0"}, JobEnd(["seed=0"]), own)
        text = joint_table(cells_table([job]))
        assert text.splitlines()[0] == "| " + " | ".join([*head, "seeds", "note"]) + " |"
        assert "| 1 | one seed |" in text


def test_two_keys_have_a_map_and_one_seed_is_told(default_config: Config, tmp_path: Path) -> None:
    short = changed(default_config, "student.total_steps=1000")
    sweep = swept(tmp_path, short, {"eta": ["0.3", "0.7"], "noise": ["0.05", "0.1"]})
    directory = write_joint(Sweep(**(vars(sweep) | {"usual": {"student.total_steps": 2000}})), tmp_path)
    cells = pd.read_csv(directory / "cells.csv")
    assert set(cells["note"]) == {"one seed, short budget"}
    assert cells["low"].isna().all()
    assert (directory / "table.md").read_text(encoding="utf-8").count("one seed, short budget") == 4
    assert pd.read_csv(directory / "jobs.csv")["budget"].tolist() == ["student.total_steps 1000 of 2000"] * 4


def test_held_out_seeds_have_rows_and_figures_of_their_own(
    default_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds = [str(seed) for seed in range(11)]
    sweep = swept(tmp_path, default_config, {"eta": ["0.3", "0.7"], "seed": seeds}, fail="eta=0.7 seed=10")
    monkeypatch.setattr(sweep_cells, "NUMBERS", ["average/aligned/student", "average/aligned/reduction_percent"])
    directory = write_joint(sweep, tmp_path)
    cells = pd.read_csv(directory / "cells.csv").set_index(["eta", "number", "group"])
    error = cells.loc[(0.3, "average/aligned/student")]
    assert error["seeds"].to_dict() == {"held out": 6, "chose the settings": 5}
    assert error["mean"].to_dict() == pytest.approx({"held out": 0.0235, "chose the settings": 0.018})
    assert (error["low"] < error["mean"]).all()
    text = (directory / "table.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith(("| 0.3 | ", "| 0.7 | ")) and " [" in line]
    assert [row.split(" | ")[1] for row in rows] == ["held out", "chose the settings"] * 2
    assert rows[0].endswith("| 1 | 0.0156 | 6 |  |")  # 1 / 64
    assert "Students of seeds 5, 6, 7, 8, 9, 10 (held out) and seeds 0, 1, 2, 3, 4 (chose the settings);" in text
    drawn = headline_jobs(results(sweep, tmp_path))
    assert [each.seed for each in drawn] == [5, 6, 7, 8, 9, 10, 5, 6, 7, 8, 9]


def test_jobs_that_were_lost_and_artifacts_that_are_damaged(default_config: Config, tmp_path: Path) -> None:
    sweep = swept(tmp_path, default_config, {"seed": ["0", "1"]})
    (tmp_path / "sweeps" / "2030-01-01" / "jobs.jsonl").write_text("", encoding="utf-8")
    directory = write_joint(read_sweep(sweep.directory), tmp_path)
    assert f"- {UNFINISHED}: seed=0, seed=1\n" in (directory / "table.md").read_text(encoding="utf-8")
    assert "No job has numbers to compare." in (directory / "table.md").read_text(encoding="utf-8")
    for path in tmp_path.glob("artifacts/evaluation/*/mse.csv"):
        path.write_text("damaged\n", encoding="utf-8")
    directory = write_joint(sweep, tmp_path)
    assert (directory / "table.md").read_text(encoding="utf-8").count("SHA-256") == 2


def test_a_job_that_ran_again_counts_as_it_ended_last(tmp_path: Path) -> None:
    write_sweep(tmp_path, "made", "x", [["eta=0.3"], ["eta=0.5"]], machine={}, started=0.0, usual={})
    note_end(JobEnd(["eta=0.3"], error="diverged"))
    note_end(JobEnd(["eta=0.3"], {"teacher": "there"}))
    sweep = read_sweep(tmp_path)
    assert sweep.end_of(["eta=0.3"]).error is None
    assert sweep.end_of(["eta=0.5"]).error == UNFINISHED
    assert sweep.swept == ["eta"]
    assert position(["eta=0.5", "threads=1"]) == (2, 2)
    assert position(["eta=0.9"]) is None
    assert sweeps(tmp_path.parent) == []  # it is not under sweeps/
    os.environ[SWEEP_VARIABLE] = ""
    note_end(JobEnd(["eta=0.5"]))
    assert position(["eta=0.5"]) is None
    assert len(read_sweep(tmp_path).ends) == 2


def test_what_says_only_how_a_job_runs_tells_none_apart() -> None:
    overrides = ["+eta=0.3", "threads=2", "paths.outputs=/x", "hydra/launcher=joblib", "tracking=none", "stage=all"]
    assert settings(overrides) == {"eta": "0.3"}


def drawn(sweep: Sweep, outputs: Path) -> dict[str, Figure]:
    """The figures of a sweep, laid out but not saved."""
    found = results(sweep, outputs)
    return figures(cells_table(found), jobs_table(found), sweep.title)


def test_points_intervals_and_seeds_of_a_figure(default_config: Config, tmp_path: Path) -> None:
    sweep = swept(tmp_path, default_config, {"eta": ["0.7", "0.3"], "seed": ["0", "1", "2"]})
    found = drawn(sweep, tmp_path)
    assert set(found) == {"by_eta"}
    axes = next(each for each in found["by_eta"].axes if each.get_title("left") == "aligned error, average [m²]")
    student, *_ = axes.containers  # an errorbar: line, caps, bars
    x, y = student.lines[0].get_data()
    assert list(x) == [0.3, 0.7]
    assert list(y) == pytest.approx([0.017, 0.025])
    (bars,) = student.lines[2]
    assert bars.get_segments()[0][:, 1] == pytest.approx([0.016, 0.018])
    dots = next(line for line in axes.lines if line.get_marker() == "o")
    assert sorted(dots.get_ydata())[:3] == pytest.approx([0.016, 0.017, 0.018])
    assert "mean of 3 seeds, smallest to largest, a dot per seed" in found["by_eta"].get_suptitle()


def test_two_keys_have_lines_and_a_map_and_many_have_points(default_config: Config, tmp_path: Path) -> None:
    values = {"eta": ["0.3", "0.7"], "noise": ["0.05", "0.1", "0.2"]}
    found = drawn(swept(tmp_path / "two", default_config, values), tmp_path / "two")
    assert set(found) == {"by_eta", "by_noise", "map_eta_noise"}
    assert len(found["by_eta"].axes[0].containers) == 3
    grid = found["map_eta_noise"].axes[0].images[0].get_array()
    assert grid.shape == (2, 3)
    assert grid[:, 0].tolist() == pytest.approx([84.0, 76.0])  # 1 - 0.016 / 0.1 and 1 - 0.024 / 0.1
    assert "one seed, no interval" in found["by_eta"].get_suptitle()
    many = {"eta": ["0.3", "0.7"], "noise": [str(0.01 * (i + 1)) for i in range(7)]}
    found = drawn(swept(tmp_path / "many", default_config, many), tmp_path / "many")
    (points,) = found["by_eta"].axes[0].containers
    assert len(points.lines[0].get_xdata()) == 14
    assert "the 7 combinations of noise together" in found["by_eta"].get_suptitle()


def test_every_two_of_three_keys_have_a_map_over_the_rest(default_config: Config, tmp_path: Path) -> None:
    values = {"eta": ["0.3", "0.7"], "noise": ["0.05", "0.1"], "speed": ["1", "4"]}
    found = drawn(swept(tmp_path, default_config, values), tmp_path)
    assert {name for name in found if name.startswith("map")} == {"map_eta_noise", "map_eta_speed", "map_noise_speed"}
    grid = found["map_noise_speed"].axes[0].images[0].get_array()
    assert grid.ravel().tolist() == pytest.approx([80.0] * 4)  # of 84 at eta 0.3 and 76 at 0.7
    assert found["map_noise_speed"].axes[0].get_xlabel() == "speed"


def test_best_jobs_cost_and_reuse(default_config: Config, tmp_path: Path) -> None:
    sweep = swept(tmp_path, default_config, {"eta": ["0.3", "0.7"], "seed": ["0", "1"]})
    text = (write_joint(sweep, tmp_path) / "table.md").read_text(encoding="utf-8")
    best = text.partition("## Best jobs")[2].splitlines()[4]
    assert best.startswith("| 0.3 | 1 | 84.5 | 0.017 | 84.5 | 0 | 4 | ")  # 1 - 0.017 / 0.11
    rows = {row[1]: row[2:7] for line in text.splitlines() if len(row := [x.strip() for x in line.split("|")]) == 8}
    assert rows["teacher"] == ["4", "2", "0", "2.0", "2.0"]  # of each seed one, for two jobs
    assert rows["student"] == ["4", "4", "0", "4.0", "0.0"]
    assert "14.0 minutes of training and measuring, one stage after the other; 6.0 more were saved." in text
    for path in tmp_path.glob("artifacts/baseline/*/manifest.json"):
        os.utime(path, (0.0, 0.0))  # older than the sweep
    text = (write_joint(sweep, tmp_path) / "table.md").read_text(encoding="utf-8")
    assert "12.0 minutes of training and measuring, one stage after the other; 8.0 more were saved." in text


def test_students_without_a_baseline_are_told_by_their_errors(default_config: Config, tmp_path: Path) -> None:
    sweep = swept(tmp_path, default_config, {"eta": ["0.3", "0.7"]}, baseline=math.nan)
    text = (write_joint(sweep, tmp_path) / "table.md").read_text(encoding="utf-8")
    row = next(line for line in text.splitlines() if line.startswith("| 0.7 |"))
    assert [cell.strip() for cell in row.split("|")][2:6] == ["-", "-", "-", "0.024"]
    assert row.endswith("| one seed, baseline falls |")
    assert text.partition("## Best jobs")[2].splitlines()[4].startswith("| 0.3 | 0 | - | 0.016 |")
    cells = pd.read_csv(tmp_path / "sweeps" / "2030-01-01" / "results" / "cells.csv")
    drawn = figures(cells.astype({"eta": str}), jobs_table(results(sweep, tmp_path)), "eta")["by_eta"]
    titles = [axes.get_title(loc="left") for axes in drawn.axes]
    assert "aligned error, average [m²]" in titles
    assert not any("reduction" in title for title in titles)
    assert "combinations" not in drawn.get_suptitle()
