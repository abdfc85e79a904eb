"""The evaluation over a grid of commands: what it writes of walkers that do not fall, and where it goes on."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from romgrl.artifacts import load_arrays
from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.config.schema import Config
from romgrl.gait.alignment import last_windows
from romgrl.gait.distances import scale_of
from romgrl.gait.features import gait_from_reference
from romgrl.gait.gait_classes import classified
from romgrl.gait.mmd import mmd_test
from romgrl.humanoid.model import configured, fingerprint
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.provenance import grid_episodes
from romgrl.provenance.source_digest import stage_files
from romgrl.provenance.stage_graph import STAGES, plan
from romgrl.provenance.stage_keys import stage_function, stage_key, stage_settings
from romgrl.report.grid_tables import evaluation_metrics, evaluation_tables, grid_names
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import grid_evaluation
from romgrl.stages.conditioned import asked_episodes, grid_cells, transitions
from romgrl.stages.conditioned.asked_episodes import Asked, blocks, command_table, made_once
from romgrl.stages.conditioned.cells import CommandCells, read_command_cells
from romgrl.stages.conditioned.grid_cells import GridCells
from romgrl.stages.conditioned.grid_summary import diagonal_percent
from romgrl.stages.conditioned.transitions import asked_ramp, asked_transitions, ramp_rows, transition_row
from romgrl.stages.grid_evaluation import matrix_of
from romgrl.stages.wiring.humanoid import humanoid_env
from tests.conftest import Composer
from tests.helpers.commanded import commanded, small_library
from tests.helpers.configurations import with_value
from tests.helpers.cut_trainings import files
from tests.helpers.synthetic_gait import run
from tests.helpers.walkers import write_walker

SMALL = ("stage=evaluation", "evaluation.episodes=2", "evaluation.window=60", "student.taught_step=2")
TABLES = ("grid.csv", "confusion.csv", "mmd.csv", "transitions.csv", "ramp.csv")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    place = tmp_path_factory.mktemp("grid")
    found = {name: place / name for name in ("library", "student", "baseline")}
    small_library(found["library"])
    names = PlanarHumanoidVectorEnv(commands=command_table(("run", "walk"), [Asked((0.0,), (1.0,), ((1.0, 0.0),))], 1))
    for seed, name in enumerate(("student", "baseline")):
        found[name].mkdir()
        path, seen = found[name] / "policy.safetensors", list(names.observation_names[-10:])
        whole = fingerprint(configured_of())
        write_walker(path, seed=seed, humanoid=whole, columns=362, names=seen)
    return found


def configured_of() -> Any:
    from romgrl.cli.compose import compose_config

    return configured(compose_config().humanoid)


def lying(config: Config, **settings: Any) -> PlanarHumanoidVectorEnv:
    """An environment in which nothing is a fall."""
    env = humanoid_env(config, **settings)
    env.task = replace(env.task, pelvis_height=-9.0, head_height=-9.0, lean=99.0)
    return env


@pytest.fixture
def config(compose_config: Composer, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Short episodes of walkers that go on where they lie."""
    for module in (grid_cells, grid_evaluation):
        monkeypatch.setattr(module, "EPISODE_SECONDS", 2.2)
    for module in (transitions, grid_evaluation):
        monkeypatch.setattr(module, "BEFORE", 0.5)
        monkeypatch.setattr(module, "AFTER", 0.5)
        monkeypatch.setattr(module, "LEAD", 0.5)
        monkeypatch.setattr(module, "RAMP_SECONDS", 2.0)
    monkeypatch.setattr(asked_episodes, "humanoid_env", lying)
    return commanded(compose_config, *SMALL)


def test_an_evaluation_writes_every_table_and_goes_on_where_it_was_left(
    config: Config, inputs: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asked_episodes, "MOST_STEPS", 400)  # three cells in a block
    (tmp_path / "whole").mkdir()
    grid_evaluation.run(config, inputs, tmp_path / "whole", SilentLog())
    shutil.copytree(tmp_path / "whole" / CHECKPOINT, tmp_path / "again" / CHECKPOINT)
    left, torn = (tmp_path / "again" / CHECKPOINT / f"student_{name}.npz" for name in ("cells_001", "ramp"))
    left.unlink()
    torn.write_bytes(torn.read_bytes()[:1000])
    grid_evaluation.run(config, inputs, tmp_path / "again", SilentLog())
    assert files(tmp_path / "again") == files(tmp_path / "whole")
    tables = {name: pd.read_csv(tmp_path / "whole" / name) for name in TABLES}
    look_at_cells(tables["grid.csv"])
    counts = tables["confusion.csv"].set_index(["walker", "asked"])
    assert counts.sum(axis=1).loc["student"].tolist() == [6, 4]
    assert counts.loc[("teacher", "run"), "run"] == 6
    assert tables["mmd.csv"].columns.tolist() == ["student", "run 2", "run 3", "run 4", "walk 1", "walk 2"]
    assert np.isfinite(tables["mmd.csv"].iloc[:, 1:]).all(axis=None)
    asked = ["walk 1 -> run 4", "run 4 -> walk 1", "walk 2 -> run 2", "run 2 -> walk 2", "stand -> walk 1"]
    assert tables["transitions.csv"].transition.tolist() == asked * 2
    assert tables["ramp.csv"].groupby(["walker", "direction"]).asked_m_per_s.mean().round(1).tolist() == [2.5] * 4
    recorded = load_arrays(tmp_path / "whole" / "recordings.npz")
    shapes = {name: values.shape for name, values in recorded.items()}
    states = shapes["cell_states"][-1]
    assert shapes == {
        "cell_states": (5, 66, states),
        "cell_features": (5, 66, 5),
        "cell_velocity": (5, 66),
        "cell_contact": (5, 66, 2),
        "cell_valid": (5, 66),
        "cell_speed": (5,),
        "cell_gait": (5,),
        "ramp_states": (60, states),
        "ramp_features": (60, 5),
        "ramp_velocity": (60,),
        "ramp_contact": (60, 2),
        "ramp_valid": (60,),
        "ramp_command": (60, 4),
        "gaits": (2,),
        "dt": (),
    }
    assert recorded["ramp_command"][30].tolist() == [4.0, 0.5, 0.5, 1.0]
    found = json.loads((tmp_path / "whole" / "grid.json").read_text(encoding="utf-8"))
    assert found["reached"] == 8 - len(found["missed"]) - len(found["not_measured"])
    assert "error_over_specialist" in found["not_measured"]
    assert {*evaluation_metrics(tmp_path / "whole")} <= {*grid_names()}
    assert [len(table.rows) for table in evaluation_tables(tmp_path / "whole")] == [5, 10, 8]


def look_at_cells(table: pd.DataFrame) -> None:
    """Rows of walkers and null models at each cell."""
    assert table.groupby("walker", sort=False).size().to_dict() == {
        "student": 5,
        "baseline": 5,
        "teacher": 5,
        "sinusoid": 5,
        "statue": 5,
    }
    by = {name: rows.reset_index(drop=True) for name, rows in table.groupby("walker")}
    assert by["student"].speed_m_per_s.tolist() == [2.0, 3.0, 4.0, 1.0, 2.0]
    assert by["student"].taught.tolist() == [True, False, True, False, True]
    assert (by["student"].falls == 0).all()
    assert (by["student"].error_over_variance > 0.5).all()  # they lie on the ground
    assert not by["student"].speed_held.any()
    np.testing.assert_allclose(by["teacher"].error_over_variance, 0.0, atol=0.03)
    assert (by["teacher"].obeyed_gait[:3] == 1.0).all()
    assert (by["teacher"].speed_error_m_per_s.abs() < 1e-6).all()


@pytest.fixture
def cells(inputs: dict[str, Path], compose_config: Composer) -> CommandCells:
    return read_command_cells(inputs["library"], commanded(compose_config), span=100)


def test_null_models_stand_beside_each_reference(cells: CommandCells) -> None:
    for cell in range(4):
        by = {row["walker"]: row for row in GridCells(cells, 100).reference_rows(cell)}
        assert [*by] == ["teacher", "sinusoid", "statue"]
        assert by["statue"]["error_over_variance"] == pytest.approx(1.0, abs=0.06)
        assert by["teacher"]["error_over_variance"] < 0.03 < by["sinusoid"]["error_over_variance"] < 0.3
        assert by["sinusoid"]["stride_frequency_hz"] == pytest.approx(by["teacher"]["stride_frequency_hz"], rel=0.03)
        assert np.isnan([by["statue"]["stride_frequency_hz"], by["sinusoid"]["steady_speed_m_per_s"]]).all()


def test_references_are_of_their_own_gait_and_nearest_to_themselves(cells: CommandCells) -> None:
    """The walks of this library have the footfall of a run. One half of each made up reference against the others."""
    assert [set(classified(cells.teacher(cell))) for cell in range(3)] == [{"run"}] * 3
    assert GridCells(cells, 60).names == ["run 2", "run 3", "run 4", "walk 1", "walk 2"]
    made = [list(run(episodes=8, steps=120, amplitude=0.2 + 0.05 * n, frequency=1.2 + 0.1 * n)[0]) for n in range(4)]
    halves = [last_windows(each[0::2], 60) for each in made]
    mmd = matrix_of(halves, [each[1::2] for each in made], 60)
    assert (mmd.argmin(axis=1).tolist(), diagonal_percent(mmd)) == ([0, 1, 2, 3], 100.0)
    assert (np.diag(mmd) < 0.02).all()
    scale = scale_of(made[1][1::2], 60)
    one, _ = mmd_test(scale.standardised(halves[1]), scale.standardised(scale.windows), scale.bandwidth, seed=0)
    assert mmd[1, 1] == pytest.approx(one)  # what distances.csv calls mmd
    assert np.isnan(matrix_of([halves[0][:1], *halves[1:]], made, 60)[0]).all()


def test_transitions_and_ramp_are_those_that_the_library_has(cells: CommandCells) -> None:
    assert [str(each) for each in asked_transitions(cells, standing=True)] == [
        *("walk 1 -> run 4", "run 4 -> walk 1", "walk 2 -> run 2", "run 2 -> walk 2", "stand -> walk 1")
    ]
    assert asked_ramp(cells) == (("walk", "run"), 1.0, 4.0)
    runs = type(cells)(("run",), cells.gait[:3], cells.speed[:3], cells.taught[:3], [], cells.dt, cells.table)
    assert [str(each) for each in asked_transitions(runs, standing=False)] == ["run 2 -> run 4", "run 4 -> run 2"]
    assert asked_ramp(runs) == (("run",), 2.0, 4.0)
    at = asked_ramp(cells).asked(cells).at(np.array([4.0, 19.0, 34.0, 49.0, 64.0]))
    assert at[:, 0].tolist() == [1.0, 2.5, 4.0, 2.5, 1.0]
    assert at[:, 1:].tolist() == [[0.5, 0.5, 1.0]] * 5
    held = Asked((0.0, 5.0), (1.0, 4.0), ((0.0, 1.0), (1.0, 0.0))).at(np.array([4.9, 5.0]))
    assert held.tolist() == [[1.0, 0.0, 1.0, 1.0], [4.0, 1.0, 0.0, 1.0]]


def made_up(cells: CommandCells, speed: Any, steps: int) -> Any:
    """A reference at other speeds, of two episodes, the second of which falls in the end."""
    rng = np.arange(steps) % 112  # seven strides
    arrays = {name: np.concatenate([cells.references[2][name][rng]] * 2) for name in ("features", "contact")}
    arrays |= {"episode": np.repeat([0, 1], steps), "velocity": np.tile(speed, 2), "dt": np.array(cells.dt)}
    gait = gait_from_reference(arrays)
    gait.valid[1, -1], gait.fallen[1] = False, True
    return gait


def test_a_transition_is_measured_from_the_change_on(cells: CommandCells) -> None:
    after = np.where(np.arange(300) < 30, 3.0, np.where(np.arange(300) < 60, 4.5, 4.0))
    gait = made_up(cells, np.concatenate((np.full(150, 2.0), after)), 450)
    asked = asked_transitions(cells, standing=False)[0]
    row = transition_row(cells, asked, "student", gait)
    assert (row["episodes"], row["falls"], row["settled"], row["obeyed_gait"]) == (2, 1, 1, 0.5)
    assert row["settling_time_s"] == pytest.approx(2.05, abs=0.05)  # the mean over a stride is late by a step or two
    assert row["overshoot_m_per_s"] == pytest.approx(0.5)


def test_the_ramp_is_cut_into_speeds_asked_for(cells: CommandCells) -> None:
    asked = np.interp(np.arange(600), (0, 300, 599), (2.0, 4.0, 2.0))
    rows = pd.DataFrame(ramp_rows("student", made_up(cells, asked + 0.1, 600), asked))
    assert rows.direction.tolist() == ["up"] * 8 + ["down"] * 8
    assert rows.falls.tolist() == [0] * 15 + [1]
    np.testing.assert_allclose(rows.speed_error_m_per_s, 0.1)
    np.testing.assert_allclose(rows.stride_frequency_hz, 1.0 / (16 * cells.dt), rtol=0.1)
    np.testing.assert_allclose(rows.duty_factor, 0.3, atol=0.05)
    np.testing.assert_allclose(rows.asked_m_per_s[:2], [2.125, 2.375], atol=0.01)


def test_a_block_that_was_made_as_another_one_is_made_anew(tmp_path: Path) -> None:
    made = []

    def make() -> tuple[Any, dict[str, Any]]:
        made.append(1)
        return [len(made)], {"values": np.arange(3)}

    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    assert [made_once(first, make)[0], made_once(first, make)[0]] == [[1], [1]]
    second.write_bytes(first.read_bytes())
    numbers, arrays = made_once(second, make)
    assert (numbers, sorted(arrays)) == ([2], ["values"])
    assert made_once(second, make)[0] == [2]


def test_blocks_hold_whole_groups() -> None:
    groups = [Asked((0.0,), (1.0,), ((1.0,),))] * 5
    assert [len(block) for block in blocks(groups, asked_episodes.MOST_STEPS // 2)] == [2, 2, 1]
    assert [len(block) for block in blocks(groups, 10 * asked_episodes.MOST_STEPS)] == [1] * 5


def test_the_evaluation_of_a_conditioned_student_has_stage_and_key_of_its_own(compose_config: Composer) -> None:
    nothing: Any = lambda stage: False  # noqa: E731
    order = ["teacher", "library", "student", "baseline", "evaluation"]
    assert plan(["evaluation"], nothing, conditioned=True) == order
    config, usual = compose_config("experiment=every_speed", "stage=evaluation"), compose_config()
    assert stage_function("evaluation", config) == "romgrl.stages.grid_evaluation:run"
    assert stage_function("evaluation", usual) == STAGES["evaluation"].function == "romgrl.stages.evaluation:run"
    assert "evaluation.specialists" not in stage_settings("evaluation", usual)  # as before there were any
    key = stage_key("evaluation", config, {})
    same, others = ("speed", 3.0), (("student.taught_step", 0.5), ("evaluation.episodes", 3), ("reference.steps", 900))
    assert stage_key("evaluation", with_value(config, *same), {}) == key
    assert all(stage_key("evaluation", with_value(config, *each), {}) != key for each in others)
    assert grid_episodes.__name__ in stage_files(stage_function("evaluation", config), drawing=False)
