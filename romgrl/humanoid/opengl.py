"""What the environment says of OpenGL: a wish for pictures of the humanoid, nothing that physics depends on."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import MutableMapping
from contextlib import suppress
from typing import Any

VARIABLE, PLATFORM, DEVICE = "MUJOCO_GL", "PYOPENGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID"
OFF = ("disable", "disabled", "off", "false", "0")
ANY = ("", "enable", "enabled", "on", "true", "1")
BACKENDS = ("egl", "osmesa", "glfw") if sys.platform.startswith("linux") else ("cgl", "glfw")


def import_mujoco() -> None:
    """Import MuJoCo without a backend, which may be unknown, missing or broken: `open_context` imports one to draw."""
    value = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "disable"
    try:
        importlib.import_module("mujoco")
    finally:
        del os.environ[VARIABLE]
        os.environ |= {} if value is None else {VARIABLE: value}


def wish() -> str:
    """What MUJOCO_GL asks for, as MuJoCo reads it; nothing where it is not set."""
    wanted = os.environ.get(VARIABLE, "").lower().strip()
    return "glfw" if wanted == "glx" else wanted


def candidates() -> tuple[str, ...]:
    """The backends in the order in which they are tried: the one that is asked for first."""
    wanted = wish() if wish() in BACKENDS else os.environ.get(PLATFORM, "").lower()
    return tuple(sorted(BACKENDS, key=lambda name: name != wanted))


def remark(name: str) -> str | None:
    """The line about a wish of the environment that the backend `name` does not fulfil; None where it does."""
    wanted, device = wish(), os.environ.get(DEVICE)
    if wanted not in (*ANY, *BACKENDS):
        told = f"{VARIABLE}={os.environ[VARIABLE]!r} is not allowed; allowed: {', '.join(BACKENDS)}, disable"
    elif device and name != "egl" and candidates()[0] == "egl":
        told = f"EGL does not work here with {DEVICE}={device!r}"
    elif wanted in BACKENDS and wanted != name:
        told = f"{VARIABLE}={wanted} does not work here"
    else:
        return None
    return f"{told}; drawn with {name}"


def free(environment: MutableMapping[str, str], name: str) -> None:
    """Remove what keeps MuJoCo's module of a backend from being imported, though the backend may work."""
    if environment.get(PLATFORM) != name:
        environment.pop(PLATFORM, None)  # set for another program
    if not environment.get(DEVICE):
        environment.pop(DEVICE, None)


def import_triton() -> None:
    """Import Triton, if torch came with it, before Mesa: its LLVM crashes the process where Mesa's was loaded first."""
    with suppress(ImportError):
        importlib.import_module("triton")


def open_context(name: str, width: int, height: int) -> Any:
    """An offscreen OpenGL context of a backend, made current."""
    free(os.environ, name)
    import_triton()
    context = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
    context.make_current()
    return context
