"""Figures with the right artists in the right colours, tables, films and the report stage."""

from __future__ import annotations

import html
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from romgrl.config.schema import Config
from romgrl.gait.alignment import mse_table
from romgrl.gait.features import Floats, Gait
from romgrl.gait.measures import MEASURES
from romgrl.gait.metrics import describe
from romgrl.humanoid.model import build
from romgrl.humanoid.rendering import RenderingError
from romgrl.humanoid.skeleton import SMPL
from romgrl.report import figures, film, markdown_report, style, tables
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import report
from tests.helpers import finished
from tests.helpers.synthetic_gait import DT, run

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"


def walker(features: Floats, fallen: int = 0) -> Gait:
    """Episodes at 4 m/s, the first `fallen` of which fall at once."""
    down = np.arange(len(features)) < fallen
    valid = np.broadcast_to(~down[:, None], features.shape[:2]).copy()
    return Gait(features, valid, down, DT, velocity=np.full(features.shape[:2], 4.0))


@pytest.fixture(scope="module")
def gaits() -> dict[str, Gait]:
    return {
        "teacher": walker(run(episodes=4, steps=400, frequency=1.75)[0]),
        "student": walker(run(episodes=4, frequency=1.8, height=0.87, noise=0.01)[0]),
        "baseline": walker(run(episodes=4, frequency=2.4, height=0.75, noise=0.01, amplitude=0.5)[0]),
    }


@pytest.fixture(scope="module")
def errors(gaits: dict[str, Gait]) -> pd.DataFrame:
    return mse_table(reference=gaits["teacher"], student=gaits["student"], baseline=gaits["baseline"], window=100)


@pytest.fixture(scope="module")
def gait_rows(gaits: dict[str, Gait]) -> pd.DataFrame:
    return pd.DataFrame({"walker": name, **describe(gait, target_speed=4.0)} for name, gait in gaits.items())


def pairs(gaits: dict[str, Gait]) -> dict[str, figures.Pair]:
    found = {name: report.typical_pair(gaits[name], gaits["teacher"], 100) for name in ("student", "baseline")}
    return {name: pair for name, pair in found.items() if pair is not None}


def colors(figure: Figure) -> list[set[str]]:
    """Which of the three colours the lines of each plot have."""
    return [
        {c for c in (BLUE, ORANGE, GREEN) if any(same_color(line.get_color(), c) for line in axes.lines)}
        for axes in figure.axes
    ]


def test_paths_show_all_three_walkers(gaits: dict[str, Gait]) -> None:
    figure = figures.paths(pairs(gaits), DT, 4.0)
    everyone = {BLUE, ORANGE, GREEN}
    assert colors(figure) == [{BLUE, GREEN}, {ORANGE, GREEN}, everyone, everyone, everyone]
    pelvis = figure.axes[0].lines[0]  # the teacher over ground at 4 m/s
    np.testing.assert_allclose(np.diff(pelvis.get_xdata()), 4.0 * DT)


def test_time_series_is_solid_teacher_and_dashed_student(gaits: dict[str, Gait]) -> None:
    pair = pairs(gaits)["student"]
    figure = figures.time_series(pair, DT, 4.0)
    assert colors(figure) == [{BLUE, GREEN}] * 3
    for axes, channel in zip(figure.axes, (0, 1, 3), strict=True):
        teacher, student = axes.lines
        assert (teacher.get_linestyle(), student.get_linestyle()) == ("-", "--")
        np.testing.assert_array_equal(teacher.get_ydata(), pair.teacher[:, channel])
        np.testing.assert_array_equal(student.get_ydata(), pair.window[:, channel])


def test_bars_have_the_heights_of_the_table(errors: pd.DataFrame) -> None:
    figure = figures.error_bars(errors, 4.0)
    rows = errors[errors.alignment == "aligned"].set_index("channel")
    drawn = {}
    for axes, channels in zip(
        figure.axes, (["pelvis_y", "left_foot_z", "right_foot_z"], ["left_foot_x", "right_foot_x"]), strict=True
    ):
        baseline, student = axes.containers
        for name, bars, color in (("baseline", baseline, ORANGE), ("student", student, BLUE)):
            assert all(same_color(bar.get_facecolor(), color) for bar in bars)
            drawn |= {(name, c): bar.get_height() for c, bar in zip(channels, bars, strict=True)}
    for (name, channel), height in drawn.items():
        assert height == pytest.approx(float(rows.loc[channel, name]))
    assert len(drawn) == 10


def test_figures_say_what_is_not_comparable(gaits: dict[str, Gait]) -> None:
    fallen = {**gaits, "baseline": walker(gaits["baseline"].features, fallen=4)}
    table = mse_table(reference=fallen["teacher"], student=fallen["student"], baseline=fallen["baseline"], window=100)
    texts = [text.get_text() for axes in figures.error_bars(table, 4.0).axes for text in axes.texts]
    assert texts.count("not\ncomparable") == 5
    figure = figures.paths(pairs(fallen), DT, 4.0)
    assert colors(figure)[1] == set()
    assert "not comparable" in figure.axes[1].texts[0].get_text()
    assert "not comparable" in figures.time_series(None, DT, 4.0).axes[0].texts[0].get_text()


def test_learning_curves(tmp_path: Path) -> None:
    curve = pd.DataFrame({"step": [1, 2, 3], "speed": [1.0, 2.0, 3.0], "episode_seconds": [1.0, np.nan, 3.0]})
    figure = figures.learning_curves({"student": curve, "baseline": curve}, {"student": 4.0, "baseline": 4.0})
    assert colors(figure)[:2] == [{BLUE, ORANGE}, {BLUE, ORANGE}]
    assert figure.axes[2].texts[0].get_text() == "not recorded"
    first, second = style.save(figure, tmp_path, "curves")
    assert first.read_bytes()[:4] == b"\x89PNG"
    assert second.read_bytes()[:4] == b"%PDF"


def test_a_saved_figure_is_not_blank_and_the_same_twice(errors: pd.DataFrame, tmp_path: Path) -> None:
    import imageio.v3 as imageio

    contents = []
    for run_number in range(2):
        directory = tmp_path / str(run_number)
        directory.mkdir()
        png, pdf = style.save(figures.error_bars(errors, 4.0), directory, "mse")
        contents.append((png.read_bytes(), pdf.read_bytes()))
    assert contents[0] == contents[1]
    picture = np.asarray(imageio.imread(png))[..., :3].reshape(-1, 3).astype(int)
    for red, green, blue in ((0, 114, 178), (213, 94, 0)):  # blue and orange
        assert (np.abs(picture - [red, green, blue]).max(axis=1) < 8).mean() > 0.004


def test_markdown() -> None:
    table = pd.DataFrame({"name": ["a|b", "c"], "x": [0.0123456, np.nan], "n": [3, 16]})
    assert tables.markdown(table).splitlines() == [
        "| name | x | n |",
        "|---|---:|---:|",
        "| a\\|b | 0.01235 | 3 |",
        "| c | - | 16 |",
    ]


def test_units_in_brackets() -> None:
    assert MEASURES["mean_speed_m_per_s"].title == "mean speed [m/s]"
    assert MEASURES["pelvis_height_m"].title == "pelvis height [m]"
    assert MEASURES["duty_factor"].title == "duty factor"


def test_headline_and_remarks(errors: pd.DataFrame, gait_rows: pd.DataFrame) -> None:
    average = errors[(errors.channel == "average") & (errors.alignment == "aligned")].iloc[0]
    assert f"{average.reduction_percent:.1f} % below" in markdown_report.summary(errors, gait_rows)
    assert "Student upright in 4 of 4 episodes at 4.00 m/s" in markdown_report.summary(errors, gait_rows)
    pooled = 100 * (1 - average.student / average.baseline)
    assert f"reduced by {pooled:.1f} %" in markdown_report.remarks(errors)


def test_stride_steps_span_one_stride() -> None:
    steps = film.stride_steps(np.zeros((300, 48)), 1.5, DT, 8)
    assert (steps[0], steps[-1], len(steps)) == (279, 299, 8)
    assert film.stride_steps(np.zeros((5, 48)), float("nan"), DT, 3).tolist() == [0, 2, 4]


def test_stick_figure_of_a_standing_humanoid() -> None:
    model = build()
    segments, right = film.side_view(model, np.zeros(model.nq), SMPL.right_side)
    assert segments.shape == (23, 2, 2)
    assert 8 <= right.sum() <= 10
    assert segments[..., 1].max() - segments[..., 1].min() > 1.3
    pictures = {"student": np.zeros((3, model.nq)), "baseline": np.zeros((3, model.nq))}
    times = dict.fromkeys(pictures, np.arange(3.0))
    figure = film.strip_of_sticks(model, pictures, times, SMPL.right_side)
    assert [same_color(axes.collections[1].get_color()[0], BLUE) for axes in figure.axes] == [True] * 3 + [False] * 3


def test_film_has_every_frame(tmp_path: Path) -> None:
    import imageio.v3 as imageio

    frames = [np.full((48, 64, 3), 20 * index, np.uint8) for index in range(10)]
    film.write_film(tmp_path / "a.mp4", iter(frames), DT)
    back = imageio.imread(tmp_path / "a.mp4", plugin="FFMPEG")
    assert back.shape == (10, 48, 64, 3)
    np.testing.assert_allclose(back.mean(axis=(1, 2, 3)), 20 * np.arange(10), atol=4)


def test_stage_without_opengl(
    smoke_config: Config,
    gaits: dict[str, Gait],
    errors: pd.DataFrame,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_camera(model: object) -> None:
        raise RenderingError("no OpenGL here")

    monkeypatch.setattr(report, "SideCamera", no_camera)
    smoke_config.evaluation = replace(smoke_config.evaluation, episodes=4, steps=300, window=100)
    states = dict.fromkeys(("student", "baseline"), np.zeros((30, 48)))
    inputs = finished.write(tmp_path, gaits, states, speed=4.0)
    finished.write_trainings(inputs)
    log, output = SilentLog(), tmp_path / "report"
    output.mkdir()
    report.run(smoke_config, inputs, output, log)
    names = {"paths", "time_series", "mse", "learning_curves", "filmstrip", "gait"}
    assert {path.stem for path in output.glob("*.png")} == names == {path.stem for path in output.glob("*.pdf")}
    assert not list(output.glob("*.mp4"))
    assert (output / "report.html").stat().st_size < 8e6
    assert log.messages[0] == "no films, and stick figures for poses: no OpenGL here"
    text = (output / "report.md").read_text(encoding="utf-8")
    average = errors[(errors.channel == "average") & (errors.alignment == "aligned")].iloc[0]
    assert f"{average.reduction_percent:.1f} % below" in text
    assert all(f"({name}.png)" in text for name in names)
    assert (output / "mse.md").read_text(encoding="utf-8") in text
    assert (output / "distances.md").read_text(encoding="utf-8") in text
    nulls = (output / "null_models.md").read_text(encoding="utf-8")
    assert f"## What a null model scores\n\n{markdown_report.NULL_MODELS_SAID}\n\n{nulls}" in text
    assert "|  | teacher (floor) | teacher, stretched | student | sinusoid | statue | baseline |" in nulls
    page = (output / "report.html").read_text(encoding="utf-8")
    assert "What a null model scores" in page
    for line in nulls.splitlines()[2:]:
        cells = [html.escape(cell.strip(), quote=False) for cell in line.split("|")[1:-1]]
        assert f"<th>{cells[0]}</th>{''.join(f'<td>{cell}</td>' for cell in cells[1:])}</tr>" in page.replace(
            "&#39;", "'"
        )
