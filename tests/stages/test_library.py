"""stage=library: which cells it has, what of each it says, and that a finished one is not made again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from romgrl.artifacts import load_arrays
from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.load_metrics import peak_force
from romgrl.provenance.library_grid import library_cells
from romgrl.report.library_table import library_metrics, library_tables
from romgrl.rom.gait_clocks import RUN
from romgrl.rom.phase_policy import PhasePolicy
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import library
from romgrl.stages.wiring.teacher_policy import save_phase_policy
from tests.conftest import Composer

FEW = ("threads=1", "reference.steps=120", "reference.episodes=4", "reference.warmup_steps=2", "library.orbit_worlds=2")


def asked(config: Config) -> list[tuple[float, float]]:
    return [(at.teacher.speed, at.teacher.stiffness_share) for at in library_cells(config)]


def test_cells_are_the_speeds_and_stiffnesses_that_a_teacher_has_learned(compose_config: Composer) -> None:
    ranging = compose_config("teacher=variable_running", "teacher.speeds=[1.8,2.5]", "library.stiffness_shares=[0.7,1]")
    assert asked(ranging) == [(speed, share) for speed in (2.0, 2.25, 2.5) for share in (0.7, 1.0)]
    again = compose_config("teacher=variable_running", "teacher.speeds=[2,2.25]", "library.stiffness_shares=[1,1]")
    assert asked(again) == [(2.0, 1.0), (2.25, 1.0)]
    assert asked(compose_config("library.speed_step=0.5")) == [(4.0, 1.0)]
    jumping = library_cells(compose_config("teacher=jumping", "library.apex_step=0.2"))
    assert [(at.teacher.speed, at.teacher.apex) for at in jumping] == [(0.0, 0.2), (0.0, 0.4)]
    narrow = compose_config("teacher=variable_running", "teacher.speeds=[1.8,1.9]", "teacher.stiffness_shares=null")
    assert asked(narrow) == [(1.8, 1.0)]  # no multiple of the step lies within


def test_peaks_are_of_whole_stances() -> None:
    """The first and the last one are cut; a foot that is up for two steps has not left, one that is down for two
    scuffs."""
    force = np.zeros((1, 32, 2))
    force[0, :24, 0] = [5, 5, 0, 0, 0, 1, 3, 2, 0, 0, 0, 1, 4, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0, 0]
    force[0, 28:, 0] = 9
    assert peak_force(force, np.ones((1, 32), bool)) == pytest.approx(3.5)
    assert np.isnan(peak_force(force, np.arange(32)[None] < 6))


@pytest.mark.parametrize(("asked", "held"), [(4.0, 4.19), (4.0, 3.81), (0.0, -0.04), (0.5, 0.54)])
def test_a_cell_holds_its_speed(asked: float, held: float) -> None:
    library.check_speed(asked, held)
    for wrong in (asked + 2 * (held - asked), float("nan")):
        with pytest.raises(ArtifactError, match=rf"holds {wrong:.2f} m/s: off by more than 0\.\d\d"):
            library.check_speed(asked, wrong)


def test_a_cell_jumps_to_its_apex() -> None:
    library.check_apexes({"jumps": 9.0, "jump_apex_error_m": 0.029})
    library.check_apexes({"falls": 0.0})
    for count, error in ((9.0, 0.031), (0.0, float("nan"))):
        with pytest.raises(ArtifactError, match=f"misses: {count:.0f} jumps, .* limit 0.03"):
            library.check_apexes({"jumps": count, "jump_apex_error_m": error})


@pytest.fixture
def falling(compose_config: Composer, tmp_path: Path) -> tuple[Config, Path]:
    """Four cells of a controller that falls within seconds, and its teacher's artifact."""
    config = compose_config("teacher=cmaes", *FEW, "teacher.algorithm=cmaes", "stage=library")
    (tmp_path / "teacher").mkdir()
    save_phase_policy(tmp_path / "teacher" / "policy.safetensors", PhasePolicy(RUN.mean))
    config.teacher.speeds, config.teacher.stiffness_shares = [3.0, 3.25], [0.7, 1.0]
    config.library.stiffness_shares = [0.7, 1.0]
    return config, tmp_path / "teacher"


def workspace(tmp_path: Path) -> Path:
    """What a stage finds: a directory with a place for its checkpoint."""
    output = tmp_path / "library.partial"
    output.mkdir()
    return output


def test_refused_cells_stay_in_the_table_with_the_reason(falling: tuple[Config, Path], tmp_path: Path) -> None:
    config, teacher = falling
    output = workspace(tmp_path)
    library.run(config, {"teacher": teacher}, output, log := SilentLog())
    told = [line for line in log.messages if "m/s is not fit to be imitated: the reference falls: in" in line]
    assert [line[:15] for line in told] == ["run at 3 m/s is", "run at 3.25 m/s"]  # on legs that are taught
    table, arrays = pd.read_csv(output / "library.csv"), load_arrays(output / "library.npz")
    assert table[["speed_m_per_s", "stiffness_share"]].to_numpy().tolist() == [list(pair) for pair in asked(config)]
    assert not table.fit.any()
    assert table.reason.str.contains("the reference falls: in . of 4 episodes, limit 0").all()
    assert arrays["features"].shape == (4, 120, 5)
    assert arrays["contact"].shape == (4, 120, 2)
    whole = arrays["episode"] >= 0
    assert (np.isfinite(arrays["features"]).all(axis=2) == whole).all()
    assert 0 < whole.sum() < whole.size
    assert library_metrics(output) == {"cells": 4.0, "fit_percent": 0.0}
    assert (output / "gait_atlas.png").stat().st_size > 10_000
    assert "Fit to be imitated: 0 of 4 cells." in (output / "report.html").read_text("utf-8")
    (shown,) = library_tables(output)
    assert shown.row_count == 4


@pytest.mark.parametrize("damage", ["cut short", "another cell"])
def test_a_finished_cell_survives_an_interruption(
    falling: tuple[Config, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    config, teacher = falling
    output, made = workspace(tmp_path), []
    make = library.make_cell

    def interrupted(at: Config, directory: Path) -> library.Cell:
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(at.teacher.speed)
        return make(at, directory)

    monkeypatch.setattr(library, "make_cell", interrupted)
    with pytest.raises(KeyboardInterrupt):
        library.run(config, {"teacher": teacher}, output, SilentLog())
    cells = sorted((output / CHECKPOINT).iterdir())
    assert len(cells) == 2
    cells[1].write_bytes(b"cut short" if damage == "cut short" else cells[0].read_bytes())
    made.clear()

    def counted(at: Config, directory: Path) -> library.Cell:
        made.append(at.teacher.speed)
        return make(at, directory)

    monkeypatch.setattr(library, "make_cell", counted)
    library.run(config, {"teacher": teacher}, output, SilentLog())
    assert made == [3.0, 3.25, 3.25]
    monkeypatch.undo()
    other = tmp_path / "other"
    other.mkdir()
    library.run(config, {"teacher": teacher}, other, SilentLog())
    assert (other / "library.csv").read_bytes() == (output / "library.csv").read_bytes()


def test_the_table_says_what_is_not_human(tmp_path: Path) -> None:
    fit = {
        "gait": "run",
        "fit": "True",
        "reason": "",
        "speed_m_per_s": 4.0,
        "steady_speed_m_per_s": 4.0,
        "stride_frequency_hz": 2.5,
    }
    fit |= {"duty_factor": 0.3, "pelvis_excursion_m": 0.08, "multiplier": 0.4}
    refused = {"gait": "run", "fit": "False", "reason": "the reference hops", "speed_m_per_s": 5.0, "multiplier": 0.9}
    pd.DataFrame([fit, refused]).to_csv(tmp_path / "library.csv", index=False)
    assert library_metrics(tmp_path) == {"cells": 2.0, "fit_percent": 50.0, "largest_multiplier": 0.4}
    (table,) = library_tables(tmp_path)
    said = [*table.columns[-1].cells]
    assert said == ["yes; not human: stride frequency, stride length", "the reference hops"]
