"""Teacher, student and baseline side by side, the looping picture of the README, and machines that cannot draw."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from romgrl.artifacts import write_manifest
from romgrl.config.schema import Config
from romgrl.humanoid import rendering
from romgrl.humanoid.model import build
from romgrl.report import film, readme_preview, side_by_side_film
from romgrl.rom.drawing import GROUND, draw
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import report
from romgrl.stages.wiring.rom import rom_parameters
from tests.helpers.synthetic_gait import DT, run


def test_the_teacher_stands_where_the_humanoid_does(smoke_config: Config) -> None:
    features = run(episodes=2, steps=20, frequency=1.75)[0].reshape(-1, 5).astype(np.float32)
    episode = np.repeat([0, 1], [15, 25]).astype(np.int32)
    teacher = side_by_side_film.FilmedTeacher(
        {"features": features, "episode": episode, "dt": np.array(DT), "speed": np.array(4.0)},
        rom_parameters(smoke_config),
        draw,
        GROUND,
    )
    frames = teacher.frames((480, 336), steps=20)
    assert len(frames) == 20
    assert frames[0].shape == (480, 336, 3)
    ground = [int(np.flatnonzero((frame[:, 2] != frame[0, 2]).any(axis=1))[0]) for frame in frames]
    assert set(ground) <= {455, 456}  # 0.95 of the height, with a smooth edge
    assert len(teacher.frames((480, 336), steps=99)) == 25  # the longest episode


def test_all_walk_side_by_side_and_one_that_fell_stays() -> None:
    columns = {name: [np.full((48, 32, 3), value, np.uint8)] * 2 for name, value in (("teacher", 10), ("student", 20))}
    columns["baseline"] = [np.full((48, 32, 3), 30, np.uint8)]
    frames = [*side_by_side_film.together(columns)]
    assert len(frames) == 2
    for frame in frames:
        assert frame.shape == (48, 96, 3)
        assert frame[40, ::32, 0].tolist() == [10, 20, 30]


def test_a_machine_without_egl_and_osmesa_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every OpenGL is really tried, in a process that fails."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(rendering, "_PROBE", "import sys; sys.exit(sys.argv[1] + ': no driver')")
    rendering.backend.cache_clear()
    log = SilentLog()
    try:
        assert report.open_camera(build(), log) is None
    finally:
        rendering.backend.cache_clear()
    (line,) = log.messages
    assert line.startswith(
        "no films, and stick figures for poses: no OpenGL for pictures of the humanoid (tried egl, osm"
    )


def finished_report(outputs: Path, key: str, frames: np.ndarray, age: float) -> Path:
    """A report with a film of all walkers."""
    directory = outputs / "artifacts" / "report" / key
    directory.mkdir(parents=True)
    film.write_film(directory / side_by_side_film.FILM, iter(frames), DT)
    write_manifest(
        directory,
        stage="report",
        key=key,
        config={},
        inputs={},
        versions={},
        revision=None,
        dirty=None,
        seed=0,
        wall_time=1,
    )
    os.utime(directory / side_by_side_film.FILM, (age, age))
    return directory


def test_the_preview_loops_after_whole_strides(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    phase = 2 * np.pi * np.arange(90) / 45  # a stride of 1.5 s
    shade = 120 + 50 * np.stack([np.sin(phase), np.cos(phase), 0 * phase], axis=-1)
    frames = np.broadcast_to(shade[:, None, None], (90, 48, 96, 3)).astype(np.uint8)
    finished_report(tmp_path, "0" * 16, frames[:30], age=1.0)
    newest = finished_report(tmp_path, "1" * 16, frames, age=2.0)
    assert readme_preview.newest_film(tmp_path) == newest / side_by_side_film.FILM
    found, rate = readme_preview.read_film(newest / side_by_side_film.FILM)
    assert (len(found), round(rate)) == (90, 30)
    assert abs(len(readme_preview.loop(found, rate)) - 45) <= 1
    readme_preview.main([str(tmp_path), str(tmp_path / "images" / "preview.webp")])
    image = Image.open(tmp_path / "images" / "preview.webp")
    assert (image.n_frames, image.size, image.info["loop"]) == (23, (720, 360), 0)
    assert "preview.webp: 0.0" in capsys.readouterr().out


def test_no_preview_without_a_report_or_too_large(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit) as ended:
        readme_preview.main([str(tmp_path), str(tmp_path / "preview.webp")])
    assert ended.value.code == 3
    assert "no finished report with side_by_side.mp4" in capsys.readouterr().err
    monkeypatch.setattr(readme_preview, "LARGEST", 100)
    noise = np.random.default_rng(0).integers(0, 255, (4, 24, 48, 3), np.uint8)
    with pytest.raises(readme_preview.ArtifactError, match="2 pictures do not fit into 100 bytes"):
        readme_preview.animation(noise, 30.0)
    assert Image.open(io.BytesIO(animation_of(monkeypatch, noise))).n_frames == 2


def animation_of(monkeypatch: pytest.MonkeyPatch, frames: np.ndarray) -> bytes:
    """An animation that may be as large as it is."""
    monkeypatch.setattr(readme_preview, "LARGEST", 10**9)
    return readme_preview.animation(frames, 30.0)
