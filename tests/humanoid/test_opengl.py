"""MUJOCO_GL and its like: a wish for pictures that may not be fulfilled; physics runs whatever they say."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from romgrl.humanoid import opengl, rendering
from tests.helpers.jobs import ROOT

# As on a machine where neither EGL nor OSMesa is installed.
BARE = """
import ctypes, ctypes.util
found, load = ctypes.util.find_library, ctypes.CDLL.__init__
missing = lambda name: any(word in str(name) for word in ("EGL", "OSMesa"))
ctypes.util.find_library = lambda name: None if missing(name) else found(name)

def loaded(self, name, *arguments, **options):
    if missing(name):
        raise OSError(f"{name}: cannot open shared object file")
    load(self, name, *arguments, **options)

ctypes.CDLL.__init__ = loaded
"""
PHYSICS = "import os; from romgrl.humanoid.model import build; print(build().nq, os.environ['MUJOCO_GL'])"
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other backends")


@LINUX
@pytest.mark.parametrize("wish", ["egl", "OSMesa", "nonsense", "egl,osmesa", ""])
def test_physics_needs_no_opengl(wish: str, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(BARE, encoding="utf-8")
    environment = os.environ | {"MUJOCO_GL": wish, "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    done = subprocess.run(
        [sys.executable, "-c", PHYSICS], env=environment, capture_output=True, text=True, check=False, encoding="utf-8"
    )
    assert done.stdout == f"24 {wish}\n", done.stderr  # children, and who draws, see the wish as it was


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """No wish at all; the backend works that the variable WORKS names."""
    for name in (opengl.VARIABLE, opengl.PLATFORM, opengl.DEVICE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(rendering, "_PROBE", "import os, sys; sys.exit(sys.argv[1] != os.environ['WORKS'])")
    rendering.backend.cache_clear()
    yield monkeypatch
    rendering.backend.cache_clear()


@LINUX
@pytest.mark.parametrize(
    ("variables", "works", "remark"),
    [
        ({}, "osmesa", None),
        ({"MUJOCO_GL": "osmesa"}, "osmesa", None),
        ({"MUJOCO_GL": " EGL "}, "egl", None),
        ({"MUJOCO_GL": "glx"}, "glfw", None),
        ({"MUJOCO_GL": "on"}, "osmesa", None),
        ({"MUJOCO_GL": "egl"}, "osmesa", "MUJOCO_GL=egl does not work here; drawn with osmesa"),
        (
            {"MUJOCO_GL": "egl,osmesa"},
            "egl",
            "MUJOCO_GL='egl,osmesa' is not allowed; allowed: egl, osmesa, glfw, disable; drawn with egl",
        ),
        (
            {"MUJOCO_EGL_DEVICE_ID": "7"},
            "osmesa",
            "EGL does not work here with MUJOCO_EGL_DEVICE_ID='7'; drawn with osmesa",
        ),
        ({"MUJOCO_EGL_DEVICE_ID": "7", "MUJOCO_GL": "osmesa"}, "osmesa", None),
        ({"PYOPENGL_PLATFORM": "egl"}, "osmesa", None),
    ],
)
def test_the_wish_first_then_what_there_is(
    variables: dict[str, str], works: str, remark: str | None, tried: pytest.MonkeyPatch
) -> None:
    for name, value in variables.items():
        tried.setenv(name, value)
    tried.setenv("WORKS", works)
    assert rendering.backend() == works
    assert opengl.remark(works) == remark


@LINUX
def test_what_was_set_for_another_program_is_out_of_the_way() -> None:
    environment = {"PYOPENGL_PLATFORM": "egl", "MUJOCO_EGL_DEVICE_ID": "", "MUJOCO_GL": "osmesa"}
    opengl.free(environment, "osmesa")
    assert environment == {"MUJOCO_GL": "osmesa"}
    kept = {"PYOPENGL_PLATFORM": "egl", "MUJOCO_EGL_DEVICE_ID": "0"}
    opengl.free(kept, "egl")
    assert kept == {"PYOPENGL_PLATFORM": "egl", "MUJOCO_EGL_DEVICE_ID": "0"}


def test_a_driver_that_fails_after_all_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    from romgrl.humanoid.model import build

    def fail(name: str, width: int, height: int) -> None:
        raise ImportError("Cannot initialize a display.\nMore of it")

    monkeypatch.setattr(rendering, "backend", lambda: "egl")
    monkeypatch.setattr(opengl, "open_context", fail)
    with pytest.raises(rendering.RenderingError, match=r"\(egl: Cannot initialize a display\.\)$"):
        rendering.SideCamera(build())


def test_triton_is_imported_before_a_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Triton's LLVM crashes the process where the one of Mesa was loaded first."""
    order: list[str] = []

    def note(name: str) -> object:
        order.append(name)
        if name == "triton":
            raise ImportError(name)
        return SimpleNamespace(GLContext=lambda width, height: SimpleNamespace(make_current=lambda: None))

    monkeypatch.setattr(opengl.importlib, "import_module", note)
    opengl.open_context("osmesa", 8, 8)
    assert order == ["triton", "mujoco.osmesa"]
