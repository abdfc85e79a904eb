"""Programs that are called ffmpeg: a film is whole or not there, and one line says why."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from romgrl.artifacts import write_manifest
from romgrl.humanoid.model import build
from romgrl.report import encoder, readme_preview
from romgrl.report.side_by_side_film import FILM
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import report
from tests.helpers.jobs import ROOT

FRAMES = np.zeros((30, 64, 64, 3), np.uint8)
NO_ENCODER = "echo \"Unknown encoder 'libx264'\" >&2; exit 1"
PROGRAMS = {  # and what the line says of them
    NO_ENCODER: "ended with 1: Unknown encoder 'libx264'",
    'for film; do :; done; head -c 50000 >/dev/null; echo half > "$film"; exit 9': "ended with 9: it wrote no film",
    'for film; do :; done; cat >/dev/null; echo half > "$film"; echo broken >&2; exit 3': "ended with 3: broken",
    "cat >/dev/null": "ended with 0: it wrote no film",
    "exec sleep 20": "hangs: it has taken no picture for 0.2 s",
    "cat >/dev/null; exec sleep 20": "hangs: the film has not ended for 0.2 s",
}


def choose(path: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a program and let the environment choose it as ffmpeg."""
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(path))
    return path


@pytest.mark.parametrize("script", PROGRAMS)
def test_an_ffmpeg_that_does_not_work(script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = choose(tmp_path / "ffmpeg", script, monkeypatch)
    if "sleep" in script:
        monkeypatch.setattr(encoder, "STALL_SECONDS", 0.2)
    frames = FRAMES[:5] if script == "cat >/dev/null; exec sleep 20" else FRAMES  # these fit into the pipe
    with pytest.raises(encoder.FilmError) as told:
        encoder.write_film(tmp_path / "walk.mp4", iter(frames), 1 / 30)
    assert str(told.value) == f"{program} (IMAGEIO_FFMPEG_EXE) {PROGRAMS[script]}"
    assert not (tmp_path / "walk.mp4").exists()


@pytest.mark.parametrize(("program", "reason"), [("/no/such/ffmpeg", "No such file"), ("/etc/passwd", "Permission")])
def test_what_is_no_ffmpeg(program: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    with pytest.raises(encoder.FilmError, match=rf"^{program} \(IMAGEIO_FFMPEG_EXE\) does not start: {reason}"):
        encoder.write_film(tmp_path / "walk.mp4", iter(FRAMES), 1 / 30)


def test_no_half_film_stays_of_an_interrupted_job(tmp_path: Path) -> None:
    def frames() -> object:
        yield from FRAMES
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        encoder.write_film(tmp_path / "walk.mp4", frames(), 1 / 30)
    assert not (tmp_path / "walk.mp4").exists()


FIGURE = """
import sys
from pathlib import Path
from romgrl.report.style import new_figure, save
figure = new_figure(2, 2)
axes = figure.subplots()
axes.plot([1, 2], [3, 4])
axes.set_title("$x$ of_it")
save(figure, Path(sys.argv[1]), sys.argv[2])
"""


class Camera:
    """Draws nothing, as fast as that is."""

    def frame(self, state: np.ndarray) -> np.ndarray:
        """A picture of it."""
        return np.zeros((64, 64, 3), np.uint8)


def test_a_report_without_films(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = choose(tmp_path / "ffmpeg", NO_ENCODER, monkeypatch)
    (tmp_path / "baseline.mp4").write_bytes(b"of an attempt that was killed")
    log = SilentLog()
    states = {"student": np.zeros((9, 48)), "baseline": np.zeros((9, 48))}
    teacher = report.side_by_side_film.FilmedTeacher({}, None, None, 0.8)
    assert report.films_or_none(Camera(), states, teacher, 1 / 30, tmp_path, log) == []
    assert log.messages == [f"no films: {program} (IMAGEIO_FFMPEG_EXE) ended with 1: Unknown encoder 'libx264'"]
    assert not [*tmp_path.glob("*.mp4")]


def test_a_wish_that_is_not_fulfilled_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The camera knows which word of the environment it could not follow."""

    class Draws(Camera):
        remark = "MUJOCO_GL='nonsense' is not allowed"

    log = SilentLog()
    monkeypatch.setattr(report, "SideCamera", lambda model: Draws())
    assert report.open_camera(build(), log) is not None
    assert log.messages == [Draws.remark]


def test_no_preview_without_a_working_ffmpeg(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    directory = tmp_path / "artifacts" / "report" / "0123456789abcdef"
    directory.mkdir(parents=True)
    (directory / FILM).write_bytes(b"a film")
    facts = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 0, "wall_time": 1.0}
    write_manifest(directory, stage="report", key=directory.name, config={}, **facts)
    choose(tmp_path / "ffmpeg", NO_ENCODER, monkeypatch)
    with pytest.raises(SystemExit) as ended:
        readme_preview.main([str(tmp_path), str(tmp_path / "preview.webp")])
    (line,) = capsys.readouterr().err.splitlines()
    assert (ended.value.code, line.endswith("(IMAGEIO_FFMPEG_EXE): Unknown encoder 'libx264'")) == (1, True), line


def test_a_matplotlibrc_changes_no_figure(tmp_path: Path) -> None:
    """Nor does it ask for a LaTeX that is not there."""
    settings = tmp_path / "matplotlibrc"
    settings.write_text(
        "text.usetex: true\nlines.linewidth: 9\naxes.facecolor: black\nsavefig.bbox: tight\n", encoding="utf-8"
    )
    for name, variables in (("plain", {}), ("odd", {"MATPLOTLIBRC": str(settings)})):
        command = [sys.executable, "-c", FIGURE, tmp_path, name]
        subprocess.run(command, check=True, cwd=ROOT, env=os.environ | variables)
    for kind in ("png", "pdf"):
        assert (tmp_path / f"plain.{kind}").read_bytes() == (tmp_path / f"odd.{kind}").read_bytes()
