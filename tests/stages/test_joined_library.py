"""library.others: the cells of finished libraries come after those of the teacher, in every file of the artifact."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from romgrl.artifacts import load_arrays
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.provenance.stage_graph import STAGES
from romgrl.report.library_table import library_metrics
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import library
from romgrl.stages.wiring.rom import rom_parameters
from tests.conftest import Composer
from tests.helpers.synthetic_library import STEPS, synthetic_cell, synthetic_library, write_library

RUN = ("teacher=variable_running", "teacher.speeds=[4.5,4.75]", "library.stiffness_shares=[0.7]")


def own_cell(config: Config, teacher: Path) -> library.Cell:
    """A cell of the joined library's own teacher."""
    speed, share = config.teacher.speed, config.teacher.stiffness_share
    row = {"gait": config.teacher.gait, "speed_m_per_s": speed, "apex_m": 0.0, "stiffness_share": share}
    row |= {"fit": True, "reason": ""}
    row |= {"steady_speed_m_per_s": speed, "falls": 0, "multiplier": 0.5, "orbit": "stable"}
    return {**synthetic_cell(2.0, share, STEPS), "row": np.array(json.dumps(row))}


@pytest.fixture
def joined(compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library of two runs beside twelve cells of two other libraries, one of them without the newest columns."""
    walks, walked = synthetic_library(gaits=("walk",), fallen=(4,))
    hops, hopped = synthetic_library(gaits=("hop",))
    walks["foot_radius_m"], walks["roll_over_radius_m"] = 0.09, 0.4
    hops = hops.drop(columns=["foot_radius_m", "roll_over_radius_m", "teacher", "multiplier", "orbit"])
    others = [
        write_library(tmp_path / "walks", walks, walked),
        write_library(tmp_path / "hops", hops, hopped, config={"teacher.algorithm": "cmaes", "rom.foot_radius": None}),
    ]
    config = compose_config("stage=library", f"reference.steps={STEPS}", f"library.others=[{','.join(others)}]", *RUN)
    monkeypatch.setattr(library, "make_cell", own_cell)
    output = tmp_path / "library.partial"
    output.mkdir()
    library.run(config, {"teacher": tmp_path / "0123456789abcdef"}, output, SilentLog())
    return output


def test_cells_of_others_come_after_its_own(joined: Path, compose_config: Composer, tmp_path: Path) -> None:
    table, arrays = pd.read_csv(joined / "library.csv"), load_arrays(joined / "library.npz")
    assert table.gait.tolist() == ["run"] * 2 + ["walk"] * 6 + ["hop"] * 6
    assert table.speed_m_per_s.tolist()[:4] == [4.5, 4.75, 2.0, 2.0]
    at = 2
    for name in ("walks", "hops"):
        own = pd.read_csv(tmp_path / name / "library.csv")
        rows = table.iloc[at : at + 6].reset_index(drop=True)
        shared = [column for column in own if column != "foot_radius_m"]
        pd.testing.assert_frame_equal(rows[shared], own[shared], check_dtype=False)
        for array, values in load_arrays(tmp_path / name / "library.npz").items():
            found = arrays[array] if array in ("dt", "channels") else arrays[array][at : at + 6]
            np.testing.assert_array_equal(found, values)
            assert found.dtype == values.dtype
        at += 6
    assert arrays["features"].shape == (14, STEPS, 5)
    assert arrays["channels"].tolist() == list(CHANNELS)
    assert table.fit.sum() == 13
    assert np.isnan(table.multiplier[8:]).all()
    radius = rom_parameters(compose_config(*RUN)).foot_radius
    assert table.roll_over_radius_m.tolist() == [0.0] * 2 + [0.4] * 6 + [0.0] * 6
    assert table.foot_radius_m.tolist() == pytest.approx([radius] * 2 + [0.09] * 6 + [radius] * 6)


def test_page_atlas_and_table_have_all_gaits(joined: Path) -> None:
    text = (joined / "report.html").read_text("utf-8")
    data = json.loads(text.partition('id="data">')[2].partition("</script>")[0])
    assert [line["gait"] for line in data["scene"]["lines"]] == ["hop", "run", "walk", "hop", "walk"]
    assert len(data["scene"]["walkers"]) == 13
    assert {round(cell["foot_radius"], 4) for cell in data["scene"]["cells"][2:8]} == {0.09}
    assert [cell["roll_over_radius"] for cell in data["scene"]["cells"]] == [0.0] * 2 + [0.4] * 6 + [0.0] * 6
    assert '<select id="gait"><option>hop</option><option>run</option><option>walk</option></select>' in text
    assert "13 of 14 cells (hop: 6 of 6, run: 2 of 2, walk: 5 of 6)" in text
    teachers = "a run by ppo on variable_leg, seed 0, artifact 0123456789abcdef; a walk by ppo, seed 0"
    assert f"Teachers: {teachers}; a hop by cmaes, seed 3, library fedcba9876543210." in text
    assert (joined / "gait_atlas.png").stat().st_size > 10_000
    (shown,) = STAGES["library"].shown(joined, asked=True)
    line = f"library: 13 of 14 cells are fit to be imitated, see {joined / 'report.html'}"
    assert STAGES["library"].shown(joined, asked=False) == [line]
    assert [*shown.columns[0].cells] == ["run"] * 2 + ["walk"] * 6 + ["hop"] * 6
    assert library_metrics(joined)["cells"] == 14.0


def test_a_library_that_was_damaged_since_is_not_read(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Path(write_library(tmp_path / "walks", *synthetic_library(gaits=("walk",))))
    config = compose_config("stage=library", f"reference.steps={STEPS}", f"library.others=[{other}]", *RUN)
    (other / "library.csv").write_text("gait\n", encoding="utf-8")
    monkeypatch.setattr(library, "make_cell", lambda *_: pytest.fail("work was done"))
    with pytest.raises(ArtifactError, match=r"library\.csv: does not have the SHA-256 of its manifest"):
        library.run(config, {"teacher": tmp_path}, tmp_path, SilentLog())
