"""Whether the numbers of a user's MuJoCo file are those of a body that can be simulated."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.errors import ConfigurationError

LARGEST_NUMBER: Final = 1e10
"""MuJoCo takes what is larger for diverged (mjMAXVAL)."""
LONGEST_LINK, FASTEST = 10.0, 1e4
MASS, PELVIS_HEIGHT = (1.0, 1000.0), (0.2, 3.0)
_SUBSTEPS = 8

_KINDS: Final = ("geom", "pair", "body", "jnt", "dof", "actuator")  # a bad shape spoils its body, a body its joints
_DERIVED: Final = {
    *("actuator_acc0", "actuator_length0", "actuator_lengthrange", "body_invweight0", "body_subtreemass"),
    *("dof_M0", "dof_invweight0", "dof_length", "geom_aabb", "geom_rbound"),
}
_NOT_NEGATIVE: Final = {
    *("dof_armature", "dof_damping", "dof_frictionloss", "actuator_armature", "actuator_damping"),
    *("geom_friction", "pair_friction", "density", "viscosity"),
}


def _arrays(kind: str) -> list[str]:
    names = (name for name in dir(mujoco.MjModel) if name.startswith(f"{kind}_"))
    return [name for name in names if name not in _DERIVED and not name.endswith(("_user", "_rgba"))]


_ARRAYS: Final = (
    *((kind, name) for kind in _KINDS for name in _arrays(kind)),
    *(("jnt", "qpos0"), ("jnt", "qpos_spring")),
)
_OPTIONS: Final = [name for name in dir(mujoco.MjOption) if not name.startswith("_")]


def check_numbers(model: mujoco.MjModel) -> None:
    """Raise ConfigurationError for a number that is not finite, far too large, or negative where it cannot be."""
    for name in _OPTIONS:
        value = getattr(model.opt, name)
        if isinstance(value, (float, np.ndarray)):
            for _, reason in _bad(name, np.atleast_1d(value)):
                raise ConfigurationError(f"humanoid.xml: the option {name} {reason}")
    for kind, name in _ARRAYS:
        values = getattr(model, name)
        if values.dtype.kind == "f" and values.size:
            for row, reason in _bad(name, values):
                raise ConfigurationError(f"humanoid.xml: {name} of {_owner(model, kind, row)} {reason}")
    length = np.linalg.norm(model.body_pos, axis=1)
    far = int(length.argmax())
    if length[far] > LONGEST_LINK:
        raise ConfigurationError(
            f"humanoid.xml: body_pos of body {_name(model.body(far))} is {length[far]:g} m long; "
            f"needed: at most {LONGEST_LINK:g} m from the body that it hangs from"
        )


def check_size(mass: float, pelvis_height: float, root: str) -> None:
    """Raise ConfigurationError for a mass or a standing height that no humanoid has."""
    if not MASS[0] <= mass <= MASS[1]:
        raise ConfigurationError(
            f"humanoid.xml: the bodies have a mass of {mass:g} kg; needed: {MASS[0]:g} to {MASS[1]:g} kg"
        )
    if not PELVIS_HEIGHT[0] <= pelvis_height <= PELVIS_HEIGHT[1]:
        low, high = PELVIS_HEIGHT
        raise ConfigurationError(
            f"humanoid.xml: body {root} stands {pelvis_height:g} m high; needed: {low:g} to {high:g} m"
        )


def check_motion(model: mujoco.MjModel, pelvis_height: float) -> None:
    """Raise ConfigurationError unless the body, standing at rest with controls of 0, stays slow for some substeps."""
    data = mujoco.MjData(model)
    data.qpos[1] = pelvis_height
    needed = f"needed: a body that stays below {FASTEST:g} rad/s in the first {_SUBSTEPS} substeps from rest"
    try:
        for _ in range(_SUBSTEPS):
            mujoco.mj_forward(model, data)
            _refuse_wild(model, data.qacc, LARGEST_NUMBER, needed)  # mj_step would log it and start over
            mujoco.mj_step(model, data)
            _refuse_wild(model, data.qvel, FASTEST, needed)
    except mujoco.FatalError as error:
        raise ConfigurationError(f"humanoid.xml: {joined_lines(error)}; {needed}") from error


def joined_lines(error: Exception) -> str:
    """What an error says; MuJoCo tells the reason in one line and the element in the next."""
    return " ".join(str(error).split())


def _refuse_wild(model: mujoco.MjModel, values: NDArray[np.float64], limit: float, needed: str) -> None:
    wild = np.flatnonzero(~(np.abs(values) <= limit))
    if wild.size:
        joint = model.joint(model.dof_jntid[wild[0]])
        raise ConfigurationError(f"humanoid.xml: joint {_name(joint)} diverges from rest; {needed}")


def _bad(name: str, values: NDArray[Any]) -> Iterator[tuple[int, str]]:
    """The row of each bad number, and what is the matter with it."""
    least = 0.0 if name in _NOT_NEGATIVE else -LARGEST_NUMBER
    good = (values >= least) & (values <= LARGEST_NUMBER)
    if good.all():
        return
    needed = f"{least:g} to {LARGEST_NUMBER:g}"
    for place in np.argwhere(~good):
        yield int(place[0]), f"is {values[tuple(place)]:g}; needed: a number from {needed}"


def _name(element: Any) -> str:
    return element.name or "(unnamed)"


def _owner(model: mujoco.MjModel, kind: str, row: int) -> str:
    owners: dict[str, Callable[[], str]] = {
        "geom": lambda: f"geom {_name(model.geom(row))} of body {_name(model.body(model.geom_bodyid[row]))}",
        "pair": lambda: f"the contact pair of geom {_name(model.geom(model.pair_geom2[row]))}",
        "body": lambda: f"body {_name(model.body(row))}",
        "jnt": lambda: f"joint {_name(model.joint(row))}",
        "dof": lambda: f"joint {_name(model.joint(model.dof_jntid[row]))}",
        "actuator": lambda: f"actuator {_name(model.actuator(row))}",
    }
    return owners[kind]()
