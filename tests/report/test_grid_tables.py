"""Evaluations over a grid beside those of one speed: who reads which, and what a specialist is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from romgrl.artifacts import write_manifest
from romgrl.errors import ArtifactError
from romgrl.report.grid_tables import (
    BARS,
    bars_verdict,
    evaluation_metrics,
    evaluation_tables,
    grid_names,
    is_grid,
    ramp_text,
)
from romgrl.report.objective import objective_names, objective_of
from romgrl.report.specialists import Specialist, read_specialist
from romgrl.results.evaluation_index import evaluations

GAIT = (
    "walker,episodes,falls,target_speed_m_per_s,error_over_variance\n"
    "teacher,8,0,3.5,0.01\nstudent,16,2,3.5,{error}\nbaseline,16,0,3.5,2.5\n"
)


def grid() -> dict[str, Any]:
    """grid.json of a student that reaches all but one bar, and lacks one number."""
    bars: list[dict[str, Any]] = [
        {"name": name, "meaning": name, "way": way, "bar": limit, "reached": True, "student": limit, "baseline": None}
        for name, (way, limit, _) in BARS.items()
    ]
    bars[1] |= {"reached": False, "student": 6.25}
    bars[2] |= {"reached": None, "student": None}
    ramp = {"falls_percent": 0.0, "speed_error_m_per_s": 0.08, "switch_up_m_per_s": 2.2, "switch_down_m_per_s": None}
    return {
        "bars": bars,
        "reached": 6,
        "missed": ["most_falls_percent"],
        "not_measured": ["error_over_specialist"],
        "ramp": {"student": ramp},
        "ramp_gaits": ["walk", "run"],
        "human_switch_m_per_s": [1.9, 3.0],
    }


def written(directory: Path, name: str, text: str) -> Path:
    """A finished evaluation of one file."""
    directory.mkdir(parents=True)
    (directory / name).write_text(text, encoding="utf-8")
    made_from: dict[str, Any] = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 3}
    settings = {"teacher.gait": "walk"}
    write_manifest(directory, stage="evaluation", key=directory.name, config=settings, wall_time=1.0, **made_from)
    return directory


def test_numbers_of_a_grid_are_those_of_its_bars(tmp_path: Path) -> None:
    place = written(tmp_path / "artifacts" / "evaluation" / "0123456789abcdef", "grid.json", json.dumps(grid()))
    assert is_grid(place)
    numbers = evaluation_metrics(place)
    assert numbers["grid/most_falls_percent/student"] == 6.25
    assert numbers["grid/ramp_switch_up_m_per_s/student"] == 2.2
    assert not [name for name in numbers if "specialist" in name or name.endswith("baseline")]
    assert {*numbers} <= {*grid_names()} == {*objective_names("evaluation", "conditioned")}
    assert objective_of("grid/most_falls_percent/student", {"evaluation": place}) == 6.25
    assert "grid/bars_reached" not in objective_names("evaluation")
    assert len(evaluation_tables(place)[-1].rows) == len(BARS)
    assert evaluations(tmp_path) == ([], {place: "of a student that follows commands"})


def test_what_is_missed_is_told_in_words() -> None:
    assert bars_verdict(grid()) == (
        "6 of 8 bars reached; missed: most_falls_percent; not measured: error_over_specialist"
    )
    assert ramp_text(grid()) == (
        "ramp: off by 0.08 m/s, 0 % fall; left to choose, runs from 2.2 m/s on and walks below - (people: 1.9 to 3)"
    )


def test_a_specialist_is_the_student_of_a_finished_evaluation(tmp_path: Path) -> None:
    assert read_specialist(written(tmp_path / "a", "gait.csv", GAIT.format(error=0.07))) == Specialist(
        "walk", 3.5, 0.07, 2, 16
    )
    for name, text, reason in (
        ("grid.json", json.dumps(grid()), "an evaluation of no student of one speed"),
        ("gait.csv", "walker,falls\nstudent,0\n", "no column target_speed_m_per_s, error_over_variance, episodes"),
        ("gait.csv", GAIT.format(error="much"), "not a number"),
    ):
        with pytest.raises(ArtifactError, match=reason):
            read_specialist(written(tmp_path / f"{name}{len(text)}", name, text))
