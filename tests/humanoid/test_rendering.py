"""Pictures of the humanoid, where the machine has an OpenGL to draw with."""

from __future__ import annotations

import numpy as np
import pytest

from romgrl.humanoid.env import PlanarHumanoidEnv
from romgrl.humanoid.model import build
from romgrl.humanoid.rendering import RenderingError, SideCamera, backend, filmstrip
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv


@pytest.fixture(autouse=True)
def opengl() -> None:
    try:
        backend()
    except RenderingError as error:
        pytest.skip(str(error))


def standing(height: float, forward: float = 0.0) -> np.ndarray:
    state = np.zeros(48)
    state[:2] = forward, height
    return state


def test_a_body_is_seen_and_the_camera_follows() -> None:
    with SideCamera(build(), width=160, height=120) as camera:
        picture, empty = camera.frame(standing(0.98)), camera.frame(standing(-9.0))
        moved = camera.frame(standing(0.98, forward=7.0))
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    body = np.abs(picture.astype(int) - empty).sum(axis=2) > 60
    rows, columns = np.nonzero(body)
    assert 80 < np.ptp(rows) < 120  # the body fills most of the height
    assert np.ptp(columns) < 40
    assert np.abs(moved.astype(int) - picture).mean() < 2.0  # seven whole metres: the same marks


def test_environments_render() -> None:
    env = PlanarHumanoidEnv(render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    vector = PlanarHumanoidVectorEnv(num_envs=2, render_mode="rgb_array")
    vector.reset(seed=0)
    pictures = vector.render()
    env.close()
    vector.close()
    assert picture is not None
    assert picture.shape == (480, 640, 3)
    assert pictures is not None
    assert len(pictures) == 2
    assert PlanarHumanoidEnv().render() is None


def test_filmstrip() -> None:
    states = np.stack([standing(0.98, forward) for forward in np.linspace(0, 3, 20)])
    strip = filmstrip(build(), states, poses=4, width=60, height=90)
    assert strip.shape == (90, 240, 3)
    with pytest.raises(ValueError, match="at least one"):
        filmstrip(build(), states[:0])
