"""Pictures of the humanoid from the side: frames of a film and strips of poses, with or without a display."""

from __future__ import annotations

import copy
import functools
import os
import subprocess
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.errors import RomgrlError
from romgrl.humanoid import opengl
from romgrl.humanoid.model import dimensions
from romgrl.humanoid.skeleton import skeleton_of

Image = NDArray[np.uint8]
States = NDArray[np.float64] | Sequence[NDArray[np.float64]]

_FIELD_OF_VIEW = 30.0
"""Vertical angle of the camera, degrees: narrow, so that perspective hardly distorts the pose."""
_VIEW_HEIGHT = 1.32
"""Height of the picture at the body, in standing heights up to the skull base."""
_ELEVATION = -5.0
_STRIPES, _STRIPE_WIDTH = 10, 0.06
"""Marks on the floor, one per metre on either side of the body, and their width, m."""
_BACKGROUND = (0.93, 0.95, 0.97, 1.0)
_FLOOR = (0.78, 0.79, 0.80, 1.0)
_STRIPE = (0.45, 0.47, 0.50, 1.0)
_MAX_GEOMS = 2000
# os._exit: the clean-up at interpreter exit fails with some drivers although they can draw.
_PROBE = """
import importlib, os, sys
import mujoco
context = importlib.import_module(f"mujoco.{sys.argv[1]}").GLContext(8, 8)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 100)
os._exit(0)
"""


class RenderingError(RomgrlError):
    """This machine offers no OpenGL to draw with; films and pictures of the humanoid have to be left out."""


@functools.cache
def backend() -> str:
    """The OpenGL that works here: MUJOCO_GL if set, else EGL, OSMesa (software) or GLFW, whichever comes first.

    Each is tried in a process of its own, because PyOpenGL binds one library for the life of a process and a missing
    driver may abort. Raises RenderingError if none works.
    """
    if opengl.wish() in opengl.OFF:
        raise RenderingError("rendering is switched off by MUJOCO_GL")
    for name in opengl.candidates():
        environment = {**os.environ, opengl.VARIABLE: "disable"}
        opengl.free(environment, name)
        try:
            done = subprocess.run(
                [sys.executable, "-c", _PROBE, name], env=environment, capture_output=True, timeout=60, check=False
            )
        except subprocess.TimeoutExpired:
            continue
        if done.returncode == 0:
            return name
    raise RenderingError(f"no OpenGL for pictures of the humanoid (tried {', '.join(opengl.candidates())})")


class SideCamera:
    """Draws states of a planar model offscreen from its right, forward to the right, moving along with the pelvis.

    Use as a context manager, or call `close`. Raises RenderingError where nothing can be drawn.
    """

    def __init__(self, model: mujoco.MjModel, *, width: int = 640, height: int = 480) -> None:
        if width < 1 or height < 1:
            raise ValueError(f"a picture of {width} x {height} pixels has no content")
        name = backend()
        self._context: Any = None
        self.remark = opengl.remark(name)
        """What to tell about the wish of the environment that was not fulfilled."""
        self._model = _plain_copy(model, width, height)
        self._data, self._root = mujoco.MjData(self._model), skeleton_of(model).root
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.zeros((height, width, 3), dtype=np.uint8)
        try:
            self._gl = opengl.open_context(name, width, height)
            self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except Exception as error:  # whatever a driver, PyOpenGL or MuJoCo raises
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise RenderingError(f"no OpenGL for pictures of the humanoid ({name}: {reason})") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(self._model, maxgeom=_MAX_GEOMS)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = 0
        self._option, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._camera.azimuth, self._camera.elevation = 90.0, _ELEVATION
        view = _VIEW_HEIGHT * dimensions(model).head_height
        self._camera.distance = view / (2 * np.tan(np.radians(_FIELD_OF_VIEW) / 2))
        self._look_at_height = 0.45 * view

    def __enter__(self) -> SideCamera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the OpenGL context; the camera cannot be used afterwards."""
        if self._context is not None:
            self._gl.make_current()
            self._context.free()
            self._gl.free()
            self._context = None

    def frame(self, state: NDArray[np.float64]) -> Image:
        """Picture (height, width, 3) of one state: qpos first, what follows is ignored."""
        if self._context is None:
            raise ValueError("the camera is closed")
        self._data.qpos[:] = np.asarray(state)[: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        forward = float(self._data.body(self._root).xpos[0])
        self._camera.lookat[:] = (forward, 0.0, self._look_at_height)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, self._perturb, self._camera, everything, self._scene
        )
        self._add_surroundings(forward)
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        mujoco.mjr_readPixels(self._pixels, None, self._rect, self._context)
        return np.flipud(self._pixels).copy()

    def frames(self, states: States) -> list[Image]:
        """One picture per state of (T, nq or more)."""
        return [self.frame(np.asarray(state)) for state in states]

    def _add_surroundings(self, forward: float) -> None:
        """A floor with a mark at every whole metre, and a plain wall behind."""
        self._add_box((forward, 8.0, 0.0), (40.0, 0.01, 40.0), _BACKGROUND, emission=1.0)
        self._add_box((forward, 3.0, -0.01), (40.0, 5.0, 0.01), _FLOOR, emission=0.6)
        for metre in range(round(forward) - _STRIPES, round(forward) + _STRIPES + 1):
            self._add_box((float(metre), 3.0, 0.0), (_STRIPE_WIDTH / 2, 5.0, 0.001), _STRIPE, emission=0.6)

    def _add_box(
        self, position: Sequence[float], half: Sequence[float], rgba: Sequence[float], *, emission: float
    ) -> None:
        geom = self._scene.geoms[self._scene.ngeom]
        mujoco.mjv_initGeom(
            geom,
            mujoco.mjtGeom.mjGEOM_BOX.value,
            np.array(half, dtype=np.float64),
            np.array(position, dtype=np.float64),
            np.eye(3).ravel(),
            np.array(rgba, dtype=np.float32),
        )
        geom.emission, geom.specular = emission, 0.0
        self._scene.ngeom += 1


def frames(model: mujoco.MjModel, states: States, *, width: int = 640, height: int = 480) -> list[Image]:
    """One picture (height, width, 3) per state of (T, nq or more), for a film."""
    with SideCamera(model, width=width, height=height) as camera:
        return camera.frames(states)


def filmstrip(model: mujoco.MjModel, states: States, *, poses: int = 8, width: int = 240, height: int = 360) -> Image:
    """`poses` states, evenly spaced over `states` (T, nq or more), side by side in one picture."""
    if len(states) < 1 or poses < 1:
        raise ValueError("a filmstrip needs at least one state and one pose")
    chosen = np.linspace(0, len(states) - 1, min(poses, len(states))).round().astype(int)
    with SideCamera(model, width=width, height=height) as camera:
        return np.concatenate(camera.frames([states[index] for index in chosen]), axis=1)


def _plain_copy(model: mujoco.MjModel, width: int, height: int) -> mujoco.MjModel:
    """The model for pictures only: its own floor hidden, a narrow lens, even light, the picture's buffer."""
    plain = copy.copy(model)
    in_world = plain.geom_bodyid == 0
    plain.geom_rgba[in_world] = 0.0
    plain.geom_matid[in_world] = -1
    visual = plain.vis
    visual.global_.fovy, visual.global_.offwidth, visual.global_.offheight = _FIELD_OF_VIEW, width, height
    visual.headlight.ambient[:], visual.headlight.diffuse[:], visual.headlight.specular[:] = 0.35, 0.55, 0.1
    return plain
