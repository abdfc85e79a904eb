"""report.html of a library: its data are the library's, refused cells say why, and what is not known stays out."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pandas as pd
import pytest

from romgrl.gait import human_bands
from romgrl.report.gait_atlas import gait_atlas
from romgrl.report.library_cells import MEASURED_CELLS, band_curve, band_label, cell_lines, said_of
from romgrl.report.numbers import significant
from romgrl.report.page.library_page import NEIGHBORS, write_library_page
from romgrl.report.page.scene import rom_points
from romgrl.report.page.stretches import steady_stretch
from tests.helpers.synthetic_gait import DT
from tests.helpers.synthetic_library import REASON, STEPS, stride_steps, synthetic_cell, synthetic_library

BEFORE = '<script type="application/json" id="data">'


def written(folder: Path, table: pd.DataFrame, arrays: Any) -> tuple[str, dict[str, Any]]:
    """The page's HTML before its data, and the data; a number that JSON does not know fails."""

    def refuse(name: str) -> NoReturn:
        raise AssertionError(name)

    path = folder / "report.html"
    write_library_page(path, table, arrays)
    text, rest = path.read_text("utf-8").split(BEFORE)
    return text, json.loads(rest.partition("</script>")[0], parse_constant=refuse)


def charts_of(data: dict[str, Any]) -> dict[str, Any]:
    return {chart["key"]: chart for chart in data["charts"]}


def test_what_is_played_is_the_librarys(tmp_path: Path) -> None:
    table, arrays = synthetic_library()
    _, data = written(tmp_path, table, arrays)
    scene = data["scene"]
    assert {cell["foot_radius"] for cell in scene["cells"]} == {0.07}
    for number, speed in enumerate(table.speed_m_per_s):
        walker = scene["walkers"][str(number)]
        length = stride_steps(speed)
        assert walker["strides"] == [0, length, 2 * length, 3 * length]
        points = np.frombuffer(base64.b64decode(walker["points"]), "<i2").reshape(-1, 3, 2) / 1000
        whole = rom_points(arrays["features"][number])
        off = [np.abs(whole[at : at + len(points)] - points).max() for at in range(len(whole) - len(points) + 1)]
        start = int(np.argmin(off))
        assert off[start] <= 0.0006
        contact = arrays["contact"][number]
        assert walker["contact"] == contact[start : start + len(points)].astype(int).tolist()
        assert contact[start, 0]
        assert not contact[start - 1, 0]
        assert walker["x"][-1] == pytest.approx(speed * DT * 3 * length, abs=1e-3)


def test_numbers_are_the_tables(tmp_path: Path) -> None:
    table, arrays = synthetic_library(fallen=(4,))
    text, data = written(tmp_path, table, arrays)
    charts = charts_of(data)
    for number, cell in enumerate(data["scene"]["cells"]):
        row = table.loc[number]
        assert (cell["asked"], cell["fit"]) == (row.speed_m_per_s, row.fit)
        assert cell["numbers"] == [significant(row[name]) for name in MEASURED_CELLS]
    for name, label in MEASURED_CELLS.items():
        chart = charts[f"atlas-{name}"]
        traces = [trace for trace in chart["figure"]["data"] if "customdata" in trace]
        assert [trace["name"] for trace in traces] == ["stiffness × 0.7", "stiffness × 1.4"]
        for trace in traces:
            own = table.loc[trace["customdata"]]
            assert trace["x"] == own.speed_m_per_s.tolist()
            assert trace["y"] == [None if np.isnan(value) else value for value in own[name]]
            assert trace["marker"]["symbol"] == ["circle" if fit else "circle-open" for fit in own.fit]
        assert chart["cursor"]["cell"]["y"] == [None if np.isnan(value) else value for value in table[name]]
        assert f"<th>{label}</th>" in text
    assert "Fit to be imitated: 5 of 6 cells, at 2 to 4 m/s" in text
    assert "Teacher: a run by ppo, seed 0." in text
    assert all(f'<a href="{name}">' in text for name in NEIGHBORS)


def test_a_refused_cell_says_why_and_stands_still(tmp_path: Path) -> None:
    table, arrays = synthetic_library(fallen=(4,))
    text, data = written(tmp_path, table, arrays)
    assert data["scene"]["cells"][4]["said"] == REASON
    assert f'<td class="source">{REASON}</td>' in text
    assert sorted(data["scene"]["walkers"]) == ["0", "1", "2", "3", "5"]
    charts = charts_of(data)
    hover = charts["atlas-falls"]["figure"]["data"][-2]["hovertext"][2]
    assert REASON in hover.replace("<br>", " ")
    (note,) = charts["footfall-0"]["figure"]["layout"]["annotations"]
    assert (note["text"], note["y"]) == ("no steady stretch", 2)
    assert "annotations" not in charts["footfall-1"]["figure"]["layout"]


def test_footfall_is_what_is_played(tmp_path: Path) -> None:
    table, arrays = synthetic_library()
    _, data = written(tmp_path, table, arrays)
    chart = charts_of(data)["footfall-1"]
    assert chart["cursor"]["moment"]["rows"] == {"1": 0, "3": 1, "5": 2}
    left, right, landings = [trace for trace in chart["figure"]["data"] if 1.2 < np.mean(trace["y"]) < 2.8][:3]
    seconds = DT * stride_steps(4.0)
    contact = np.array(data["scene"]["walkers"]["5"]["contact"])[:-1]
    for foot, bars in enumerate((left, right)):
        assert sum(bars["x"]) == pytest.approx(DT * contact[:, foot].sum(), abs=1e-3)
    assert left["base"] == pytest.approx([0.0, seconds, 2 * seconds], abs=1e-4)
    assert landings["x"] == pytest.approx([0.0, seconds, 2 * seconds, 3 * seconds], abs=1e-4)


@pytest.mark.parametrize("fallen", [(), (0,)])
def test_a_library_of_one_cell(tmp_path: Path, fallen: tuple[int, ...]) -> None:
    text, data = written(tmp_path, *synthetic_library((4.0,), (1.0,), fallen=fallen))
    assert f"Fit to be imitated: {1 - len(fallen)} of 1 cells" in text
    assert "Asked for: 4 m/s, stiffness × 1." in text
    assert data["scene"]["start"] == 0
    assert len(data["scene"]["walkers"]) == 1 - len(fallen)
    band = charts_of(data)["atlas-duty_factor"]["figure"]["data"][0]
    assert max(band["x"]) - min(band["x"]) >= 0.1  # seen, although there is one speed alone


def test_lines_are_of_gaits_and_stiffnesses(tmp_path: Path) -> None:
    table, arrays = synthetic_library(gaits=("walk", "run"), fallen=(0,))
    table["foot_radius_m"] = np.where(table.gait == "walk", 0.07, 0.09)
    text, data = written(tmp_path, table, arrays)
    assert [cell["foot_radius"] for cell in data["scene"]["cells"]] == [0.07, 0.09] * 6
    assert "Teachers: a walk by ppo, seed 0; a run by ppo, seed 0." in text
    assert "Fit to be imitated: 11 of 12 cells (run: 6 of 6, walk: 5 of 6), at 2 to 4 m/s" in text
    lines = data["scene"]["lines"]
    assert [(line["gait"], line["share"]) for line in lines] == [
        (gait, share) for share in (0.7, 1.4) for gait in ("run", "walk")
    ]
    assert sorted(cell for line in lines for cell in line["cells"]) == list(range(12))
    assert lines[0]["color"] == lines[2]["color"] != lines[1]["color"] == lines[3]["color"]
    dashes = [trace["line"]["dash"] for trace in charts_of(data)["atlas-falls"]["figure"]["data"]]
    assert dashes == ["solid", "solid", "dash", "dash"]
    assert '<select id="gait"><option>run</option><option>walk</option></select>' in text
    one, _ = written(tmp_path, table.assign(gait="run"), arrays)
    assert 'id="gait"' not in one


def test_a_stretch_ends_as_it_began() -> None:
    cell = synthetic_cell(3.0, 1.0, STEPS)
    rise = np.linspace(0.0, 0.5, STEPS // 2, dtype=np.float32)  # over an episode: 8 cm a stride
    cell["features"][: STEPS // 2, 0] += rise
    stretch = steady_stretch(**cell, dt=DT)
    assert stretch is not None
    assert stretch.strides == [0, 20, 40, 60]
    np.testing.assert_allclose(stretch.features[-1], stretch.features[0], atol=1e-5)
    assert stretch.features[:, 0].max() < 1.0  # of the episode that does not rise
    cell["features"][STEPS // 2 :, 0] += rise
    assert steady_stretch(**cell, dt=DT) is None


def test_a_stretch_has_two_strides_where_there_are_no_three() -> None:
    cell = synthetic_cell(3.0, 1.0, 66)
    stretch = steady_stretch(**cell, dt=DT)
    assert stretch is not None
    assert stretch.strides == [0, 20, 40]
    assert steady_stretch(**synthetic_cell(3.0, 1.0, 10), dt=DT) is None


def test_bands_are_known_between_the_speeds_of_people() -> None:
    table = pd.DataFrame({"gait": ["walk", "run"], "speed_m_per_s": [1.0, 4.0]})
    places, low, high = band_curve("duty_factor", table)
    known = [human_bands.bands(float(speed)).get("duty_factor") for speed in places]
    assert np.isfinite(low).tolist() == [band is not None for band in known]
    assert (high[np.isfinite(low)] > low[np.isfinite(low)]).all()
    assert np.isnan(band_curve("falls", table)[1]).all()
    assert np.isnan(band_curve("duty_factor", table.assign(gait="hop"))[1]).all()


def test_a_hop_is_not_compared_with_walks_and_runs() -> None:
    values = {"speed_m_per_s": 4.0, "stride_frequency_hz": 3.0, "steady_speed_m_per_s": 4.0, "duty_factor": 0.3}
    values |= {"pelvis_excursion_m": 0.08}
    assert said_of(True, "", values, "run") == "yes; not human: stride frequency, stride length"
    assert said_of(True, "", values, "hop") == "yes; no human bands here"
    assert said_of(True, "", values | {"stride_frequency_hz": 1.6}, "run") == "yes"


def test_every_measure_with_human_bands_has_a_name() -> None:
    names = {band.measure: band_label(band.measure) for band in human_bands.table()}
    assert names["force_valley"] == "valley of the force"
    assert not any("_" in name or "[" in name for name in names.values())


@pytest.mark.parametrize("gaits", [("run",), ("walk", "run")])
def test_the_figure_has_a_panel_for_each_measure_that_is_there(gaits: tuple[str, ...]) -> None:
    table, _ = synthetic_library(gaits=gaits, fallen=(1,))
    figure = gait_atlas(table)
    titled = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert [axes.get_title(loc="left") for axes in titled] == list(MEASURED_CELLS.values())
    assert len(gait_atlas(table.drop(columns="net_extension_m")).axes) == 10
    labels = [text.get_text() for text in figure.axes[-1].get_legend().get_texts()]
    assert labels == [line.label for line in cell_lines(table)]


def test_the_highest_trunk_is_in_the_picture(tmp_path: Path) -> None:
    table, arrays = synthetic_library()
    low = written(tmp_path, table, arrays)[1]["scene"]["top"]
    arrays["features"][3, :, 0] += 0.6
    high = written(tmp_path, table, arrays)[1]["scene"]["top"]
    assert low == 1.15
    assert high == pytest.approx(float(arrays["features"][3, :, 0].max()) + 0.12, abs=0.01)


def test_jumps_stand_at_their_apexes(tmp_path: Path) -> None:
    """Alone, and beside runs."""
    table, arrays = synthetic_library((2.0, 3.0, 4.0), (1.0,))
    jumps = table.assign(gait="jump", speed_m_per_s=0.0, apex_m=[0.1, 0.2, 0.3], jump_apex_m=[0.1, 0.21, 0.28])
    text, data = written(tmp_path, jumps, arrays)
    assert [(cell["asked"], cell["goal"]) for cell in data["scene"]["cells"]] == [
        (apex, f"{apex:g} m") for apex in (0.1, 0.2, 0.3)
    ]
    chart = charts_of(data)["atlas-jump_apex_m"]["figure"]
    assert chart["data"][-1]["x"] == [0.1, 0.2, 0.3]
    assert chart["layout"]["xaxis"]["title"]["text"] == "apex asked for [m]"
    assert "at 0.1 to 0.3 m (held: 0.1 to 0.28 m). Asked for: 0.1 to 0.3 m, stiffness" in text
    both = pd.concat([table, jumps], ignore_index=True)
    text, _ = written(
        tmp_path,
        both,
        {name: np.concatenate([each, each]) for name, each in arrays.items() if each.ndim} | {"dt": arrays["dt"]},
    )
    assert "Asked for: 2 to 4 m/s and 0.1 to 0.3 m" in text
    titled = {axes.get_title(loc="left"): axes for axes in gait_atlas(both).axes}
    apexes, falls = titled["apex of jumps [m]"], titled["falls"]
    assert (apexes.get_xlabel(), falls.get_xlabel()) == ("apex asked for [m]", "speed asked for [m/s]")
    assert max(falls.get_lines()[0].get_xdata()) == 4.0
    assert max(apexes.get_lines()[0].get_xdata()) == 0.3
