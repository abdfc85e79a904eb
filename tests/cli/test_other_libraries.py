"""What cannot be joined with a library is told in one line, before any work."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from romgrl.artifacts import MANIFEST
from romgrl.cli.consistency import misfits
from romgrl.config.schema import Config
from tests.conftest import Composer
from tests.helpers.synthetic_gait import DT
from tests.helpers.synthetic_library import STEPS, synthetic_library, write_library

RANGE = ("teacher=variable_running", "teacher.speeds=[4.5,5]", "teacher.speed=4.5", "library.stiffness_shares=[0.7,1]")


@pytest.fixture
def asking(compose_config: Composer) -> Callable[..., Config]:
    """The configuration of a library of runs at 4.5 to 5 m/s beside others, of as many steps as synthetic ones."""

    def config(*others: Path | str, more: tuple[str, ...] = ()) -> Config:
        listed = ",".join(f"'{each}'" for each in others)
        given = (
            f"reference.steps={STEPS}",
            "reference.episodes=2",
            f"humanoid.control_frequency={round(1 / DT)}",
            *RANGE,
            *more,
        )
        return compose_config("stage=library", f"library.others=[{listed}]", *given)

    return config


def only_line(config: Config) -> str:
    (line,) = misfits(config)
    return line


def test_other_cells_are_joined(asking: Callable[..., Config], tmp_path: Path) -> None:
    runs = write_library(tmp_path / "runs", *synthetic_library())
    walks = write_library(tmp_path / "walks", *synthetic_library((4.5, 4.75, 5.0), (0.7, 1.0), gaits=("walk",)))
    assert not [*misfits(asking(runs, walks))]
    assert not [*misfits(asking("/no/such/place", more=("stage=teacher",)))]


def test_what_is_no_finished_library_is_told(asking: Callable[..., Config], tmp_path: Path) -> None:
    whole = synthetic_library()
    teacher = write_library(tmp_path / "teacher", *whole, stage="teacher")
    unfinished = Path(write_library(tmp_path / "unfinished.partial", *whole))
    (unfinished / MANIFEST).unlink()
    damaged = Path(write_library(tmp_path / "damaged", *whole))
    content = bytearray((damaged / "library.npz").read_bytes())
    content[len(content) // 2] ^= 1
    (damaged / "library.npz").write_bytes(content)
    missing = Path(write_library(tmp_path / "missing", *whole))
    (missing / "library.csv").unlink()
    older = write_library(tmp_path / "older", whole[0].drop(columns="gait"), whole[1])
    other_order = write_library(tmp_path / "order", whole[0], whole[1] | {"channels": whole[1]["channels"][::-1]})
    link = tmp_path / "link"
    link.symlink_to(link)
    cases = {
        tmp_path / "nothing": "manifest.json: missing; this is not a finished artifact",
        damaged / "library.csv": "manifest.json: missing; this is not a finished artifact",
        tmp_path: "manifest.json: missing; this is not a finished artifact",
        unfinished: "manifest.json: missing; this is not a finished artifact",
        teacher: "made by stage teacher, expected library",
        damaged: "library.npz: does not have the SHA-256 of its manifest",
        missing: "library.csv: missing",
        older: "library.csv: no column gait",
        other_order: "library.npz: channels are not pelvis_y, ",
        "/" + "x" * 300: "File name too long",
        link: "Too many levels of symbolic links",
    }
    for place, reason in cases.items():
        line = only_line(asking(place))
        assert line.startswith(f"library.others: {place}"[:90]), line
        assert f"is not allowed; allowed: finished libraries of {STEPS} steps at 30 Hz (" in line
        assert reason in line, line


def test_a_number_is_no_path_without_quotes(compose_config: Composer) -> None:
    line = only_line(compose_config("stage=library", *RANGE, "library.others=[1]"))
    assert line == (
        "library.others: 1 is not allowed; allowed: finished libraries; a path that is a number stands in quotes: "
        "library.others=['1']"
    )
    assert "/1/manifest.json: missing" in only_line(compose_config("stage=library", *RANGE, "library.others=['1']"))


def test_other_steps_are_told(asking: Callable[..., Config], tmp_path: Path) -> None:
    runs = write_library(tmp_path / "runs", *synthetic_library())
    line = only_line(asking(runs, more=("reference.steps=400",)))
    assert "finished libraries of 400 steps at 30 Hz" in line
    assert "features is (6, 240, 5); needed: (6, 400, 5)" in line
    line = only_line(asking(runs, more=("humanoid.control_frequency=60",)))
    assert "finished libraries of 240 steps at 60 Hz" in line
    assert "library.npz: dt 0.0333333; needed: 0.0166667" in line


def test_no_cell_is_there_twice(asking: Callable[..., Config], tmp_path: Path) -> None:
    table, arrays = synthetic_library((4.75,), (1.0,))
    own = write_library(tmp_path / "own", table, arrays)
    said = (
        "is not allowed; allowed: libraries whose cells are in no other (own has again: run at 4.75 m/s, stiffness × 1)"
    )
    assert said in only_line(asking(own))
    nearly = write_library(tmp_path / "nearly", table.assign(speed_m_per_s=4.75 + 1e-15), arrays)
    assert "libraries whose cells are in no other (nearly has" in only_line(asking(nearly))
    walks = write_library(tmp_path / "walks", table.assign(gait="walk"), arrays)
    shutil.copytree(walks, tmp_path / "copy")
    assert "(copy has again: walk at 4.75 m/s, stiffness × 1)" in only_line(asking(walks, tmp_path / "copy"))
    assert "(walks has again" in only_line(asking(walks, walks))
