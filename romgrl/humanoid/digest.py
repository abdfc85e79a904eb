"""What of a compiled model decides results: all that MuJoCo computes with, however many files it was read from."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

UNUSED = ("name_", "names_", "bvh_", "oct_", "key_")
"""Addresses of names, trees for searching, and keyframes, which nothing here starts from."""
UNREAD = ("_user", "pathadr")
LOOKS = (
    "mat_",
    "tex_",
    "light_",
    "cam_",
    "skin_",
    "text_",
    *(f"stat.{size}" for size in ("center", "extent", "meanmass", "meansize")),
)
LOOKING = ("_rgba", "_matid", "_group", "texcoord", "texcoordadr", "texcoordnum", "_castshadow", "_width")
HASHED_DIGITS = 30  # binary digits that count, so that another processor's last bits do not
VANISHING = 1e-12  # smaller numbers are the noise of zero


def physics_digest(model: mujoco.MjModel) -> str:
    """SHA-256 of what the simulation and the observation depend on; colours, lights and cameras do not count."""
    return _digest(model, looks=False)


def full_digest(model: mujoco.MjModel) -> str:
    """SHA-256 of physics and looks, for what is drawn."""
    return _digest(model, looks=True)


def _digest(model: mujoco.MjModel, *, looks: bool) -> str:
    counted = hashlib.sha256(json.dumps(_names(model)).encode())
    parts = [("", model), ("opt.", model.opt), ("stat.", model.stat)]
    if looks:
        parts += [(f"vis.{name}.", getattr(model.vis, name)) for name in _fields(model.vis)]
    for prefix, part in parts:
        for name in _fields(part):
            if not _counts(prefix + name, looks=looks):
                continue
            value = np.asarray(getattr(part, name))
            if value.dtype.kind in "biuf" and (prefix or value.ndim):  # the model's own numbers are sizes of its arrays
                counted.update(f"{prefix}{name} {value.shape} ".encode())
                counted.update(stable(value).tobytes())
    return counted.hexdigest()


def _fields(part: Any) -> list[str]:
    return sorted(name for name in dir(part) if not name.startswith("_") and not callable(getattr(part, name)))


def _counts(name: str, *, looks: bool) -> bool:
    if name.startswith(UNUSED) or name.endswith(UNREAD):
        return False
    return looks or not (name.startswith(LOOKS) or name.endswith(LOOKING))


def _names(model: mujoco.MjModel) -> list[list[str]]:
    """Names of bodies, joints, actuators and shapes, in their order."""
    counts = (
        (model.nbody, model.body),
        (model.njnt, model.joint),
        (model.nu, model.actuator),
        (model.ngeom, model.geom),
    )
    return [[named(index).name for index in range(count)] for count, named in counts]


def stable(values: NDArray[Any]) -> NDArray[Any]:
    """Floating point with the digits that count, the rest as it is."""
    if values.dtype.kind != "f":
        return values
    numbers = np.where(np.abs(values) < VANISHING, 0.0, values.astype(np.float64))
    mantissa, exponent = np.frexp(numbers)
    rounded: NDArray[np.float64] = np.ldexp(np.round(np.ldexp(mantissa, HASHED_DIGITS)), exponent - HASHED_DIGITS)
    return rounded
