"""The report of a student that follows commands: its page plays what was recorded and says what was measured."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from romgrl.artifacts import save_arrays
from romgrl.cli.conditioned_students import conditioned_student
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.humanoid.model import build, configured
from romgrl.humanoid.rendering import RenderingError
from romgrl.provenance.stage_graph import plan, wanted
from romgrl.provenance.stage_keys import stage_function
from romgrl.report import ramp_film
from romgrl.report.command_grid import GRID_MEASURES, row_minima, said_of_cell
from romgrl.report.grid_markdown import cost_of_gait, grid_summary_text
from romgrl.report.page.commands_page import write_commands_page
from romgrl.report.page.played_cells import played_cells
from romgrl.report.page.scene import humanoid_points
from romgrl.report.ramp_strides import gait_of_stride, ramp_strides
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import grid_report
from romgrl.stages.conditioned.grid_artifact import read_grid_tables, read_recordings
from tests.conftest import Composer
from tests.helpers.commanded import commanded
from tests.helpers.synthetic_gait import DT
from tests.helpers.synthetic_grid import CELLS, FALL_STEP, FALLS, RAMP_STEPS, STEPS, recordings, write_grid
from tests.helpers.synthetic_library import stride_steps

BEFORE = '<script type="application/json" id="data">'


class Made:
    """A report without a renderer, and what it was made from."""

    def __init__(self, folder: Path, config: Config, **options: Any) -> None:
        self.model = configured(config.humanoid)
        self.inputs = write_grid(folder / "in", **options)
        self.output = folder / "report"
        self.output.mkdir()
        self.log = SilentLog()
        grid_report.run(config, self.inputs, self.output, self.log)
        self.text, rest = (self.output / "report.html").read_text("utf-8").split(BEFORE)

        def refuse(name: str) -> NoReturn:
            raise AssertionError(name)

        self.data: dict[str, Any] = json.loads(rest.partition("</script>")[0], parse_constant=refuse)
        self.charts = {chart["key"]: chart for chart in self.data["charts"]}


def small(_: Figure, directory: Path, name: str) -> None:
    """A file in the place of a figure, which takes a second to save."""
    (directory / f"{name}.png").touch()


def blind(*_: Any, **__: Any) -> NoReturn:
    raise RenderingError("no OpenGL")


@pytest.fixture(scope="module")
def made(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grid_report, "SideCamera", blind)
        patch.setattr(grid_report, "save", small)
        yield Made(tmp_path_factory.mktemp("grid"), commanded(compose_config))


def test_a_machine_that_cannot_draw_is_told_and_has_a_report(made: Made) -> None:
    assert made.log.messages[0] == "no film of the ramp, and stick figures for poses: no OpenGL"
    found = {path.name for path in made.output.iterdir()}
    assert found == {"report.html", "report.md", "grid.png", "matrices.png", "ramp.png"}
    assert "ramp.mp4" not in made.text
    assert '<a href="ramp.png">' in made.text


def test_what_is_played_is_what_was_recorded(made: Made) -> None:
    scene, arrays, model = made.data["scene"], recordings(), made.model
    assert [(line["gait"], line["cells"]) for line in scene["lines"]] == [("run", [0, 1, 2]), ("walk", [3, 4])]
    for number, (_, speed) in enumerate(CELLS):
        walker, length = scene["walkers"][str(number)], stride_steps(speed)
        points = np.frombuffer(base64.b64decode(walker["points"]), "<i2").reshape(walker["steps"], -1, 2) / 1000
        if number == FALLS:
            assert walker["strides"][-1] == walker["steps"] - 1 < FALL_STEP
        else:
            assert walker["strides"] == [0, length, 2 * length, 3 * length]
            assert walker["x"][-1] == pytest.approx(speed * DT * 3 * length, abs=2e-3)
        whole, _ = humanoid_points(model, arrays["cell_states"][number].astype(float))
        off = [np.abs(whole[at : at + len(points)] - points).max() for at in range(STEPS - len(points) + 1)]
        assert min(off) <= 0.0006
        reference = scene["walkers"].get(f"teacher {number}")
        assert reference is None or reference["strides"][1] == length
    assert len(base64.b64decode(scene["walkers"]["ramp"]["points"])) == 2 * whole[0].size * RAMP_STEPS
    assert scene["ramp_now"][600] == "asked 3.50 m/s, run; held 3.50 m/s, 1.50 strides/s, run"


def test_a_cell_in_which_it_falls_is_played_up_to_there() -> None:
    arrays, model = recordings(), build()
    arrays["cell_contact"][FALLS] = False  # so that it has no strides
    cell = played_cells(arrays, {}, model)[FALLS]
    assert cell.stretch is not None
    assert (cell.stretch.first, len(cell.stretch.x), cell.stretch.strides) == (0, FALL_STEP, [0, FALL_STEP - 1])
    assert cell.teacher is None
    arrays["cell_valid"][FALLS, 2:] = False
    assert played_cells(arrays, {}, model)[FALLS].student is None


def test_numbers_are_the_tables(made: Made) -> None:
    grid = pd.read_csv(made.inputs["evaluation"] / "grid.csv")
    cells = made.data["scene"]["cells"]
    for number, (gait, speed) in enumerate(CELLS):
        at = grid[(grid.gait == gait) & (grid.speed_m_per_s == speed)].set_index("walker")
        held = cells[number]["numbers"][list(GRID_MEASURES).index("steady_speed_m_per_s")]
        assert held == [f"{at.steady_speed_m_per_s[name]:.2f}" for name in ("student", "baseline", "teacher")]
        assert cells[number]["good"] == (number != FALLS)
        assert made.charts["grid-duty_factor"]["cursor"]["cell"]["y"][number] == pytest.approx(
            at.duty_factor["student"]
        )
    assert cells[FALLS]["said"].startswith("Not held: 4.6 m/s; falls in 8 of 8 episodes")
    assert cells[1]["said"].endswith("its reference was never seen in training.")
    ring = made.charts["grid-error_over_variance"]["cursor"]["cell"]["y"]
    assert ring[0] == pytest.approx(-1.0)  # on a logarithmic axis
    assert ring[FALLS] is None


def test_held_out_speeds_are_open_and_a_click_plays_them(made: Made) -> None:
    traces = {trace["name"]: trace for trace in made.charts["grid-falls_percent"]["figure"]["data"]}
    assert traces["student, run"]["marker"]["symbol"] == ["circle", "circle-open", "circle"]
    assert traces["student, walk"]["marker"]["symbol"] == ["square", "square"]
    assert traces["baseline, run"]["customdata"] == [0, 1, 2]
    assert traces["student, run"]["y"] == [0.0, 0.0, 100.0]
    errors = [trace["name"] for trace in made.charts["grid-error_over_variance"]["figure"]["data"]]
    assert {"statue, run", "sinusoid, walk", "teacher, run"} <= set(errors)
    assert "never taught" in made.text


def test_matrices_transitions_and_verdicts(made: Made) -> None:
    (shares,) = made.charts["confusion"]["figure"]["data"]
    assert (shares["x"], shares["y"]) == (["run", "walk", "none"], ["run", "walk"])  # neither asked for nor seen: out
    np.testing.assert_allclose(shares["z"], [[200 / 3, 0, 100 / 3], [6.25, 93.75, 0]], atol=1e-3)
    _, nearest = made.charts["mmd"]["figure"]["data"]
    assert nearest["x"] == ["run 2", "run 2", "run 4", "walk 1", "walk 2"]
    assert nearest["y"] == ["run 2", "run 3", "run 4", "walk 1", "walk 2"]
    markdown = (made.output / "report.md").read_text("utf-8")
    assert "| cells whose speed is held | at least 90 | 80 | 0 | 100 | missed |" in markdown
    assert "| error over a specialist's | at most 1.5 | - | - | - | not measured |" in markdown
    assert "| run 2 -> run 4 | student | 8 | 1 | 7 | 1.25 | 0.1 | 1 |" in markdown
    assert made.text.count('<span class="mark refused">missed</span>') == 1
    assert "speed held in 4 of 5 cells, 8 of 40 episodes fall, error over variance 0.25" in made.text
    assert "{" not in markdown  # nothing that was to be filled in


def test_a_row_without_a_number_has_no_least() -> None:
    table = pd.DataFrame([[0.2, 0.1], [np.nan, np.nan]])
    np.testing.assert_array_equal(row_minima(table), [1.0, np.nan])


def test_the_ramp_stride_by_stride() -> None:
    strides = ramp_strides(recordings())
    assert not strides.fell
    assert [gait for gait, *_ in strides.spans] == ["walk", "run", "walk"]
    assert strides.spans[1][1] == pytest.approx(10.0, abs=1.0)  # s, at 2 m/s
    middle = np.abs(strides.starts[:-1] - 30.0).argmin()
    assert strides.cadence[middle] == pytest.approx(0.6 + 0.25 * 5.0, abs=0.1)
    fallen = ramp_strides(recordings(ramp_falls_at=300))
    assert fallen.upright == 300
    assert np.isnan(fallen.held[300:]).all()
    assert fallen.now(300) == "asked 2.00 m/s, walk; fallen"
    assert fallen.starts[-1] <= 10.0


def test_gaits_of_strides() -> None:
    flat = np.zeros((20, 2), bool)
    longer = flat.copy()
    longer[:12, 0] = longer[8:, 1] = True
    for landed, contact, gait in (
        ([0], flat, "hop"),
        ([1], flat, "hop"),
        ([6], flat, "skip"),
        ([13], flat, "skip"),
        ([10], flat, "run"),
        ([10], longer, "walk"),
        ([], longer, "walk"),
    ):
        assert gait_of_stride(contact, np.array(landed, int)) == gait


def test_frames_of_the_film_have_a_cursor_that_moves() -> None:
    strides = ramp_strides(recordings(ramp_falls_at=40))
    body = np.full((ramp_film.BODY_HEIGHT, ramp_film.WIDTH, 3), 200, np.uint8)
    frames = list(ramp_film.ramp_frames(lambda _: body, np.zeros((RAMP_STEPS, 3)), strides))
    assert len(frames) == 40
    assert frames[0].shape == (ramp_film.BODY_HEIGHT + ramp_film.STRIPS_HEIGHT, ramp_film.WIDTH, 3)
    assert (frames[0][: ramp_film.BODY_HEIGHT] != body).any()  # what there is to say
    changed = [np.flatnonzero((frame != frames[0])[ramp_film.BODY_HEIGHT :].any(axis=(0, 2))) for frame in frames]
    assert changed[39].max() > changed[20].max()


def test_poses_of_the_poster_are_of_times_before_a_fall() -> None:
    assert ramp_film.pose_steps(ramp_strides(recordings())).tolist() == [90 + 180 * place for place in range(10)]
    assert ramp_film.pose_steps(ramp_strides(recordings(ramp_falls_at=300))).tolist() == [90, 270]
    assert ramp_film.pose_steps(ramp_strides(recordings(ramp_falls_at=20))).tolist() == [19]


def test_cost_of_transport_in_words() -> None:
    rows = pd.DataFrame({"speed_m_per_s": [1.0, 1.5, 2.0, 3.0], "cost_of_transport": [0.3, 0.2, 0.25, 0.1]})
    rows["falls"] = [0, 0, 0, 1]
    assert cost_of_gait("walk", rows) == (
        "Cost of transport of its walk: a U over speed, least at 1.5 m/s, 50 % more at 1 and 25 % more at 2 m/s."
    )
    assert "no U over speed, least at 3 m/s" in cost_of_gait("walk", rows.assign(falls=[1, 0, 0, 0]))
    assert cost_of_gait("walk", rows[:2]) == ""


def test_what_is_no_evaluation_is_refused(tmp_path: Path) -> None:
    evaluation = write_grid(tmp_path)["evaluation"]
    model = build()
    arrays = recordings()
    for name, value, said in (
        ("cell_contact", arrays["cell_contact"][:, 1:], "cell_contact is"),
        ("ramp_command", arrays["ramp_command"][:, 1:], "ramp_command is"),
    ):
        save_arrays(evaluation / "recordings.npz", arrays | {name: value})
        with pytest.raises(ArtifactError, match=said):
            read_recordings(evaluation, model.nq + model.nv, DT)
    with pytest.raises(ArtifactError, match="dt"):
        read_recordings(evaluation, model.nq + model.nv, DT / 2)
    (evaluation / "grid.json").write_text("{}", "utf-8")
    with pytest.raises(ArtifactError, match="no bars"):
        read_grid_tables(evaluation)
    (evaluation / "mmd.csv").write_text("student,run 2\nrun 2,near\n", "utf-8")
    with pytest.raises(ArtifactError, match="not a table of numbers"):
        read_grid_tables(evaluation)


@pytest.mark.slow
def test_the_ramp_is_filmed(tmp_path: Path, compose_config: Composer) -> None:
    config = commanded(compose_config)
    config.evaluation = replace(config.evaluation, video=True)
    made = Made(tmp_path, config, ramp_falls_at=60)
    if "no OpenGL" in made.log.messages[0]:
        pytest.skip(made.log.messages[0])
    pictures = {f"{name}.{kind}" for name in ("grid", "matrices", "ramp") for kind in ("png", "pdf")}
    assert pictures <= {path.name for path in made.output.iterdir()}
    assert (made.output / ramp_film.RAMP_FILM).stat().st_size > 10_000
    assert '<a href="ramp.mp4">' in made.text
    assert "it fell after 2.0 s, at 0.80 m/s" in made.text


def test_said_of_a_cell_without_a_steady_speed(made: Made) -> None:
    row = read_grid_tables(made.inputs["evaluation"]).student.iloc[FALLS].copy()
    row["steady_speed_m_per_s"] = np.nan
    row["stride_frequency_hz"] = np.nan
    assert said_of_cell(row) == "no steady speed; falls in 8 of 8 episodes; not human: cost of transport, duty factor"


def test_a_student_that_falls_at_once_has_a_report(tmp_path: Path, compose_config: Composer) -> None:
    """As one that has hardly trained: nothing of it strides, and no cell can be compared."""
    config = commanded(compose_config)
    inputs = write_grid(tmp_path / "in", ramp_falls_at=0)
    directory = inputs["evaluation"]
    mmd = pd.read_csv(directory / "mmd.csv", index_col=0)
    (mmd * np.nan).to_csv(directory / "mmd.csv")
    report = grid_report.report_of(config, inputs)
    assert "fell after 0.0 s, at 0.50 m/s" in grid_summary_text(report.tables, report.strides)
    assert ramp_film.pose_steps(report.strides).tolist() == [0]
    write_commands_page(tmp_path / "report.html", report, film=None, files={})
    text = (tmp_path / "report.html").read_text("utf-8").split(BEFORE)[0]
    assert 'id="ramp"' not in text


def test_a_report_of_a_conditioned_student_is_made_from_its_library(compose_config: Composer) -> None:
    """And everything is all but a reference of one speed."""
    order = ["teacher", "library", "student", "baseline", "evaluation", "report"]
    assert plan(wanted("all", conditioned=True), lambda _: False, conditioned=True) == order
    assert "reference" in wanted("all")
    config, usual = compose_config("experiment=every_speed", "stage=report"), compose_config()
    assert stage_function("report", config) == "romgrl.stages.grid_report:run"
    assert stage_function("report", usual) == "romgrl.stages.report:run"
    assert not [*conditioned_student(config)]
