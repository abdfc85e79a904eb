"""`stage=watch`: a window where there is a display, a film where there is none, a line where there is neither."""

from __future__ import annotations

import io
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import imageio_ffmpeg
import mujoco.viewer
import pytest
from rich.console import Console

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.humanoid import rendering
from romgrl.humanoid.model import configured, fingerprint
from romgrl.pipeline import run as pipeline
from romgrl.pipeline.watch import newest
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import watch
from tests.helpers.walkers import write_walker


@pytest.fixture
def brief(smoke_config: Config) -> Config:
    """A film of a tenth of a second or three steps, whichever is longer."""
    return replace(smoke_config, stage="watch", watch=replace(smoke_config.watch, seconds=0.1))


@pytest.fixture
def student(smoke_config: Config, tmp_path: Path) -> Path:
    """A student that knows nothing."""
    directory = tmp_path / "0123456789abcdef.partial"
    directory.mkdir()
    write_walker(directory / "policy.safetensors", humanoid=fingerprint(configured(smoke_config.humanoid)))
    return directory


def test_without_a_display_a_film_is_made(
    brief: Config, student: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    log = SilentLog()
    watch.run(brief, {"student": student}, tmp_path, log)
    assert log.messages == [f"no display; 0.1 s are filmed: {tmp_path / 'student.mp4'}"]
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "student.mp4"))
    assert (frames, round(seconds, 2)) == (3, 0.1)


def test_without_display_and_opengl_a_line_says_so(
    brief: Config, student: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":no")
    monkeypatch.setattr("glfw.init", lambda: False)
    monkeypatch.setenv("MUJOCO_GL", "off")
    rendering.backend.cache_clear()
    log = SilentLog()
    with pytest.raises(rendering.RenderingError) as told:  # nothing can be watched: no success
        watch.run(brief, {"student": student}, tmp_path, log)
    rendering.backend.cache_clear()
    assert str(told.value) == "no display that opens, and no film: rendering is switched off by MUJOCO_GL"
    assert log.messages == []
    assert not (tmp_path / "student.mp4").exists()


def test_a_newer_policy_takes_over(brief: Config, student: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    monkeypatch.setattr(watch, "read_walker", lambda path, env: read.append(path) or (lambda seen: seen[:, :21]))
    env = watch.humanoid_env(brief, num_envs=1)
    states = watch.walk_on(env, student, seed=0)
    next(states)
    next(states)
    assert len(read) == 1
    write_walker(student / "new", humanoid=fingerprint(env.model), seed=1)
    (student / "new").replace(student / "policy.safetensors")
    next(states)
    assert len(read) == 2
    env.close()


def test_a_window_shows_the_walk_until_it_is_closed(
    brief: Config, student: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Window:
        def __init__(self, model: Any, data: Any) -> None:
            self.data, self.seen, self.cam = data, [], SimpleNamespace()

        def __enter__(self) -> Window:
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def sync(self) -> None:
            self.seen.append(self.data.qpos.copy())

        def is_running(self) -> bool:
            return len(self.seen) < 5

    windows: list[Window] = []

    def launch(model: Any, data: Any, **options: bool) -> Window:
        windows.append(Window(model, data))
        return windows[0]

    monkeypatch.setattr(watch, "no_viewer", lambda: None)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    watch.run(brief, {"student": student}, tmp_path, SilentLog())
    assert len(windows[0].seen) == 5
    assert windows[0].seen[0][0] != windows[0].seen[4][0]


@pytest.mark.usefixtures("fakes")
def test_what_is_watched(brief: Config, student: Path) -> None:
    """Nothing, then the policy of a checkpoint, then the finished one."""
    with pytest.raises(ArtifactError, match=r"no student of these settings.*stage=student"):
        pipeline.run(brief, console=Console(file=io.StringIO()))
    trained = pipeline.run(replace(brief, stage="student"), console=Console(file=io.StringIO()))["student"]
    places = {"teacher": trained, "student": trained}
    job: Any = SimpleNamespace(directory=places.get, config=brief)
    assert newest(job, "student") == trained
    shutil.move(trained, trained.with_name(f"{trained.name}.partial"))
    assert newest(job, "student") == trained.with_name(f"{trained.name}.partial")
