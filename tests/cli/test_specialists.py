"""Which students of one speed cannot stand beside one of every speed is told in one line, before any work."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from romgrl.artifacts import write_manifest
from romgrl.cli.consistency import misfits
from tests.conftest import Composer


def specialist(directory: Path, speed: float) -> Path:
    """A finished evaluation of a student that runs at a speed."""
    directory.mkdir()
    text = f"walker,episodes,falls,target_speed_m_per_s,error_over_variance\nstudent,16,0,{speed},0.07\n"
    (directory / "gait.csv").write_text(text, encoding="utf-8")
    made: dict[str, Any] = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 3}
    settings = {"teacher.gait": "run"}
    write_manifest(directory, stage="evaluation", key="0" * 16, config=settings, wall_time=1.0, **made)
    return directory


@pytest.mark.parametrize(
    ("speeds", "told"),
    [
        ((2.0, 3.5), None),
        ((2.0, 3.51), "gaits and speeds of the library (run at 3.51 m/s is none)"),
        ((2.0, 3.5, 2.0), "one of each gait and speed (run at 2 m/s is "),
    ],
)
def test_each_has_a_cell_for_itself(
    speeds: tuple[float, ...], told: str | None, compose_config: Composer, tmp_path: Path
) -> None:
    """What has none would be left out without a word, and of two at one the first would."""
    places = [specialist(tmp_path / str(number), speed) for number, speed in enumerate(speeds)]
    given = "evaluation.specialists=[" + ",".join(f"'{place}'" for place in places) + "]"
    lines = [*misfits(compose_config("experiment=every_speed", "stage=evaluation", given))]
    if told is None:
        assert not lines
    else:
        (line,) = lines
        assert line.startswith(f"evaluation.specialists: {places[-1]} is not allowed; allowed: ")
        assert told in line
