"""Build the planar humanoid and read its dimensions."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.config.worlds import Humanoid
from romgrl.errors import ConfigurationError
from romgrl.humanoid.load_sensors import add_sensors
from romgrl.humanoid.own_body import human_spec
from romgrl.humanoid.plausible import check_motion, check_numbers, check_size, joined_lines
from romgrl.humanoid.sagittal_plane import hold_in_plane
from romgrl.humanoid.skeleton import ROOT_JOINTS, SKELETONS, SMPL, Skeleton, skeleton_of, without_file

HEIGHT, MASS = 1.741, 73.0
CONTROL_FREQUENCY, SUBSTEPS = 30.0, 16
"""Defaults: the means of de Leva's subjects; substeps of 1/480 s."""

ABILITIES = (
    *("jnt_range", "dof_damping", "dof_armature", "actuator_ctrlrange", "actuator_forcerange"),
    *("actuator_gainprm", "actuator_biasprm", "actuator_dynprm", "jnt_stiffness", "jnt_stiffnesspoly"),
)
"""What of the model says how strong its joints are, how far they reach and what an action does."""


@dataclass(frozen=True)
class HumanoidDimensions:
    """Of the standing humanoid, legs straight, soles on the ground: kg and m."""

    mass: float
    leg_length: float
    """Height of the pelvis origin above the ankle joint."""
    ankle_height: float
    pelvis_height: float
    head_height: float
    """Origin of the head body (the joint at the skull base)."""


def build(
    *,
    xml: str | Path | None = None,
    actuation: str = "servo",
    height: float = HEIGHT,
    mass: float = MASS,
    control_frequency: float = CONTROL_FREQUENCY,
    substeps: int = SUBSTEPS,
    skeleton: Skeleton = SMPL,
) -> mujoco.MjModel:
    """The planar humanoid: nq = nv = 3 + A (root x, z, pitch, then the hinges), nu = A; see `task.controls`.

    SMPL's skeleton has A = 21 hinges. The model remembers its skeleton, see `skeleton_of`.

    Args:
        xml: a MuJoCo model with the skeleton's bodies (HumEnv's robot.xml has SMPL's) and others that are welded to
            them, held in the plane; None: the project's own, whose skeleton is SMPL's.
        actuation: "servo" (controls are the servos' targets) or "torque" (control x largest torque).
        height: of the project's own humanoid, m.
        mass: of the project's own humanoid, kg.
        control_frequency: control steps per second.
        substeps: physics steps per control step; the timestep is 1 / (control_frequency x substeps).
        skeleton: one of SKELETONS.

    Raises ValueError for bad numbers and ConfigurationError for a file that is missing or does not fit.
    """
    if actuation not in ("servo", "torque"):
        raise ValueError(f"actuation must be servo or torque, not {actuation!r}")
    for name, value in (("height", height), ("mass", mass), ("control_frequency", control_frequency)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive, not {value}")
    if substeps < 1:
        raise ValueError(f"substeps must be at least 1, not {substeps}")
    if xml is None and skeleton is not SMPL:
        raise ConfigurationError(without_file(skeleton.name))
    spec = human_spec(height=height, mass=mass) if xml is None else _load(Path(xml))
    timestep = 1.0 / (control_frequency * substeps)
    model: mujoco.MjModel = _compile(planar_spec(spec, skeleton, actuation=actuation, timestep=timestep))
    bodies = [name for name in (model.body(index).name for index in range(model.nbody)) if name in skeleton.bodies]
    joints = [model.joint(index).name for index in range(model.njnt)]
    actuators = [model.actuator(index).name for index in range(model.nu)]
    order = [*skeleton.bodies], [*ROOT_JOINTS, *skeleton.hinges], [*skeleton.hinges]
    if (bodies, joints, actuators) != order:
        raise ConfigurationError(
            f"humanoid.xml: bodies, joints and actuators must be in the order of the skeleton {skeleton.name}"
        )
    if xml is not None:
        _check_body(model)
    return model


def planar_spec(spec: mujoco.MjSpec, skeleton: Skeleton, *, actuation: str, timestep: float) -> mujoco.MjSpec:
    """The same body, held in the plane, with actuators and sensors; timestep in s. Raises ConfigurationError."""
    hold_in_plane(spec, skeleton, actuation=actuation)
    add_sensors(spec, skeleton)
    spec.option.timestep = timestep
    return spec


def configured(humanoid: Humanoid) -> mujoco.MjModel:
    """The humanoid of a configuration."""
    return build(
        xml=humanoid.xml,
        actuation=humanoid.actuation,
        height=humanoid.height,
        mass=humanoid.mass,
        control_frequency=humanoid.control_frequency,
        substeps=humanoid.substeps,
        skeleton=SKELETONS[humanoid.skeleton],
    )


def identity(model: mujoco.MjModel) -> dict[str, str]:
    """What a policy says of the humanoid that it was trained on: its fingerprint, and in words what is in that."""
    sizes = dimensions(model)
    lengths = {"mass": f"{sizes.mass:.5g} kg", "standing pelvis": f"{sizes.pelvis_height:.5g} m high"}
    lengths["standing head"] = f"{sizes.head_height:.5g} m high"
    counts = {"bodies": model.nbody, "joints": model.njnt, "actuators": model.nu}
    return {"fingerprint": fingerprint(model)} | lengths | {name: str(count) for name, count in counts.items()}


def fingerprint(model: mujoco.MjModel) -> str:
    """SHA-256 of what a policy's observations and actions mean: names of bodies, joints and actuators, mass, height,
    and what joints and actuators can do."""
    sizes = dimensions(model)
    names = [[model.body(i).name for i in range(model.nbody)], [model.joint(i).name for i in range(model.njnt)]]
    names.append([model.actuator(i).name for i in range(model.nu)])
    abilities = np.concatenate([getattr(model, name).ravel() for name in ABILITIES])
    numbers = [model.nq, model.nv, sizes.mass, sizes.pelvis_height, sizes.head_height, *(abilities + 0.0)]  # no -0
    return hashlib.sha256(json.dumps([names, [f"{number:.5g}" for number in numbers]]).encode()).hexdigest()


def _load(path: Path) -> mujoco.MjSpec:
    try:
        path = path.expanduser()
        is_there = path.is_file()
    except (OSError, RuntimeError) as error:  # a name that is too long, a user who is not known
        raise ConfigurationError(f"humanoid.xml: no such file: {path} ({joined_lines(error)})") from error
    if not is_there:
        raise ConfigurationError(f"humanoid.xml: no such file: {path}")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ConfigurationError(f"humanoid.xml: {path}: {joined_lines(error)}") from error


def _compile(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise ConfigurationError(f"humanoid.xml: {joined_lines(error)}") from error


def _check_body(model: mujoco.MjModel) -> None:
    check_numbers(model)
    if not _solid(model).size:
        raise ConfigurationError("humanoid.xml: no geom can touch the floor; needed: one with a contype or conaffinity")
    sizes = dimensions(model)
    check_size(sizes.mass, sizes.pelvis_height, skeleton_of(model).root)
    check_motion(model, sizes.pelvis_height)


def body_ids(model: mujoco.MjModel, skeleton: Skeleton | None = None) -> NDArray[np.int64]:
    """Ids (B,) of the skeleton's bodies, in its order; None: the skeleton that the model was built with."""
    bodies = (skeleton or skeleton_of(model)).bodies
    return np.array([model.body(name).id for name in bodies], dtype=np.int64)


def _solid(model: mujoco.MjModel) -> NDArray[np.int64]:
    """The shapes that can touch the floor."""
    paired = np.isin(np.arange(model.ngeom), model.pair_geom2)
    return np.flatnonzero((model.geom_bodyid > 0) & (paired | (model.geom_conaffinity > 0)))


def lowest_point(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Height of the lowest point of the shapes that can touch the floor, m, from geom_xpos and geom_xmat."""
    solid = _solid(model)
    down = np.abs(data.geom_xmat[solid].reshape(-1, 3, 3)[:, 2, :])
    size, kind = model.geom_size[solid], model.geom_type[solid]
    kinds = mujoco.mjtGeom
    extent = np.einsum("ij,ij->i", down, size)  # box
    extent = np.where(kind == kinds.mjGEOM_SPHERE, size[:, 0], extent)
    extent = np.where(kind == kinds.mjGEOM_CAPSULE, size[:, 0] + down[:, 2] * size[:, 1], extent)
    extent = np.where(kind == kinds.mjGEOM_ELLIPSOID, np.linalg.norm(down * size, axis=1), extent)
    return float((data.geom_xpos[solid, 2] - extent).min())


def dimensions(model: mujoco.MjModel) -> HumanoidDimensions:
    """Mass and lengths of the model, standing with every joint at zero."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ground = lowest_point(model, data)
    skeleton = skeleton_of(model)
    pelvis, head = data.body(skeleton.root).xpos[2], data.body(skeleton.head).xpos[2]
    ankle = (data.body(skeleton.left.ankle).xpos[2] + data.body(skeleton.right.ankle).xpos[2]) / 2
    return HumanoidDimensions(
        mass=float(model.body_mass[1:].sum()),
        leg_length=float(pelvis - ankle),
        ankle_height=float(ankle - ground),
        pelvis_height=float(pelvis - ground),
        head_height=float(head - ground),
    )
