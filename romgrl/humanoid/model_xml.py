"""The project's own humanoid as a MuJoCo file that describes it exactly."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from romgrl.config.worlds import Humanoid
from romgrl.errors import ArtifactError
from romgrl.humanoid.model import planar_spec
from romgrl.humanoid.own_body import human_spec
from romgrl.humanoid.skeleton import SMPL

DOUBLE_DIGITS = 17  # significant digits that give a double back
UNCOMPARED = ("signature",)  # MuJoCo's number of the description, not of what is compiled from it


def model_xml(humanoid: Humanoid, model: mujoco.MjModel) -> str:
    """The text from which MuJoCo alone compiles `model`, the project's own humanoid of a configuration.

    Raises ArtifactError where what is compiled from it is another model.
    """
    body = human_spec(height=humanoid.height, mass=humanoid.mass)
    timestep = 1.0 / (humanoid.control_frequency * humanoid.substeps)
    spec = planar_spec(body, SMPL, actuation=humanoid.actuation, timestep=timestep)
    spec.compile()
    with all_digits():
        text = str(spec.to_xml())
    differing = unequal_fields(mujoco.MjModel.from_xml_string(text), model)
    if differing:
        name = f"{differing[0]} differs" + (f", and {len(differing) - 1} more" if differing[1:] else "")
        raise ArtifactError(f"model.xml: MuJoCo {mujoco.__version__} reads another model than it wrote: {name}")
    return text


def unequal_fields(one: mujoco.MjModel, other: mujoco.MjModel) -> list[str]:
    """Names of all numbers, arrays and names that are not equal in two models; options and looks count."""
    parts = [("", one, other), ("opt.", one.opt, other.opt), ("stat.", one.stat, other.stat)]
    parts += [(f"vis.{name}.", getattr(one.vis, name), getattr(other.vis, name)) for name in compared_fields(one.vis)]
    return [
        prefix + name
        for prefix, part, expected in parts
        for name in compared_fields(part)
        if isinstance(value := getattr(part, name), np.ndarray | int | float | bytes)
        and not np.array_equal(value, getattr(expected, name))
    ]


def compared_fields(struct: Any) -> list[str]:
    """Names of the fields that are compared."""
    return [name for name in dir(struct) if not name.startswith("_") and name not in UNCOMPARED]


@contextmanager
def all_digits() -> Iterator[None]:
    """MuJoCo writes numbers with all of their digits, instead of six, while the block runs.

    It has no public function for that; where this one is missing, what is written is another model, and refused.
    """
    path = next(Path(mujoco.__file__).parent.glob("libmujoco.*"), None)
    library = ctypes.CDLL(str(path)) if path else None
    change = getattr(library, "_mjPRIVATE__set_xml_precision", None)
    if library is None or change is None:
        yield
        return
    before = library._mjPRIVATE__get_xml_precision()
    change(DOUBLE_DIGITS)
    try:
        yield
    finally:
        change(before)
