"""The project's own humanoid as a MuJoCo file that describes it to the last bit."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco

from romgrl.config.worlds import Humanoid
from romgrl.errors import ArtifactError
from romgrl.humanoid.digest import full_digest
from romgrl.humanoid.load_sensors import add_sensors
from romgrl.humanoid.own_body import human_spec
from romgrl.humanoid.sagittal_plane import hold_in_plane
from romgrl.humanoid.skeleton import SMPL

DOUBLE_DIGITS = 17  # significant digits that give a double back


def model_xml(humanoid: Humanoid, model: mujoco.MjModel) -> str:
    """The text from which MuJoCo alone compiles `model`, the project's own humanoid of a configuration.

    Raises ArtifactError where what is compiled from it is another model.
    """
    spec = human_spec(height=humanoid.height, mass=humanoid.mass)
    hold_in_plane(spec, SMPL, actuation=humanoid.actuation)
    add_sensors(spec, SMPL)
    spec.option.timestep = 1.0 / (humanoid.control_frequency * humanoid.substeps)
    spec.compile()
    with all_digits():
        text = str(spec.to_xml())
    if full_digest(mujoco.MjModel.from_xml_string(text)) != full_digest(model):
        raise ArtifactError(f"model.xml: MuJoCo {mujoco.__version__} reads another model than it wrote")
    return text


@contextmanager
def all_digits() -> Iterator[None]:
    """MuJoCo writes numbers with all of their digits, instead of six, while the block runs.

    It has no public function for that; where this one is missing, what is written is another model, and refused.
    """
    library = ctypes.CDLL(str(next(Path(mujoco.__file__).parent.glob("libmujoco.*"))))
    change = getattr(library, "_mjPRIVATE__set_xml_precision", None)
    if change is None:
        yield
        return
    before = library._mjPRIVATE__get_xml_precision()
    change(DOUBLE_DIGITS)
    try:
        yield
    finally:
        change(before)
