"""Hold any humanoid in the sagittal plane: three root joints and one pitch hinge per segment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.errors import ConfigurationError
from romgrl.humanoid.skeleton import ROOT_JOINTS, SKELETON_TEXT, SMPL, Skeleton

_HALF = float(np.sqrt(0.5))
_WORLD = "world"
_CONTROLS = (-1.0, 1.0)


def hold_in_plane(spec: mujoco.MjSpec, skeleton: Skeleton = SMPL, *, actuation: str) -> None:
    """Edit `spec` in place: root slides x and z and hinge pitch; of each body's joints the one about the lateral axis.

    Other joints and their actuators go, and only the floor is touched (no self-collision), which keeps the two halves
    of the body independent and the physics fast. A text of the model names its skeleton. Bodies that the skeleton does
    not have are welded to those that they hang from. Raises ConfigurationError if bodies, joints or actuators are
    missing or not those of the skeleton, or a joint is not at the origin of its body.
    """
    bodies = {body.name: body for body in spec.bodies}
    missing = [name for name in skeleton.bodies if name not in bodies]
    if missing:
        raise ConfigurationError(f"humanoid.xml: no body named {missing[0]}, as the skeleton {skeleton.name} has")
    _check_tree(spec, skeleton)
    spec.compiler.fusestatic = False  # the welded bodies are observed, too
    _hang_arms(bodies, skeleton)
    kept = {name: _pitch_joint(spec, bodies[name], skeleton) for name in skeleton.hinges}
    _keep_actuators(spec, {joint: name for name, joint in kept.items()}, actuation)
    for joint in list(spec.joints):
        if joint.name not in kept.values():
            spec.delete(joint)
    _rename({name: spec.joint(joint) for name, joint in kept.items()})
    named_before = (text for text in spec.texts if text.name == SKELETON_TEXT)
    for unused in (*spec.excludes, *spec.sensors, *named_before):
        spec.delete(unused)
    _add_root(bodies[skeleton.root], skeleton)
    for geom in spec.geoms:
        is_floor = geom.parent.name == _WORLD
        touches = bool(geom.contype or geom.conaffinity)
        geom.contype, geom.conaffinity = (int(touches and is_floor), int(touches and not is_floor))
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND.value  # one tree is one island
    spec.add_text(name=SKELETON_TEXT, data=skeleton.name)


def _check_tree(spec: mujoco.MjSpec, skeleton: Skeleton) -> None:
    """The skeleton's bodies hang together as it says, and nothing stands apart from them."""
    for body in sorted(spec.bodies[1:], key=lambda body: body.name not in skeleton.bodies):
        parent, needed = body.parent.name, skeleton.parents.get(body.name)
        if body.name == skeleton.root:
            needed = _WORLD
        elif needed is None and parent == _WORLD:
            needed = "a body of the humanoid"
        if needed is not None and parent != needed:
            raise ConfigurationError(
                f"humanoid.xml: body {body.name or '(unnamed)'} hangs from {parent or 'an unnamed body'}; "
                f"needed for the skeleton {skeleton.name}: from {needed}"
            )


def _rename(elements: Mapping[str, Any]) -> None:
    """Give each element its name, which another one of them may have had."""
    for element in elements.values():
        element.name = ""
    for name, element in elements.items():
        element.name = name


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quaternion, dtype=np.float64))
    return matrix.reshape(3, 3)


def _hang_arms(bodies: dict[str, mujoco.MjsBody], skeleton: Skeleton) -> None:
    """Turn arms that point sideways (the elbow further out than down) about the forward axis, so that they hang."""
    forward, lateral, up = skeleton.axes
    for limbs, half in ((skeleton.left, -_HALF), (skeleton.right, _HALF)):
        if limbs.shoulder is None or limbs.elbow is None:
            continue
        offset = np.abs(bodies[limbs.elbow].pos)
        if offset[lateral] > offset[up]:
            quarter_turn = np.array([_HALF, 0.0, 0.0, 0.0])
            quarter_turn[1 + forward] = half
            bodies[limbs.shoulder].quat = quarter_turn


def _standing_rotation(body: mujoco.MjsBody, skeleton: Skeleton) -> NDArray[np.float64]:
    """Orientation of a body in the world when standing: the product of its ancestors' rotations."""
    rotation = np.eye(3)
    while body.name != skeleton.root:
        rotation = _rotation(body.quat) @ rotation
        body = body.parent
    return skeleton.base_rotation @ rotation


def _pitch_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, skeleton: Skeleton) -> str:
    """Align the joint nearest the world's lateral axis with it, pointing left, and return its name."""
    lateral = _standing_rotation(body, skeleton).T @ np.array([0.0, 1.0, 0.0])
    hinges = [joint for joint in body.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
    if not hinges:
        raise ConfigurationError(f"humanoid.xml: body {body.name} has no hinge")
    joint = max(hinges, key=lambda candidate: abs(float(np.dot(candidate.axis, lateral))))
    if np.any(joint.pos):
        raise ConfigurationError(f"humanoid.xml: joint {joint.name} must be at the origin of its body")
    if np.dot(joint.axis, lateral) < 0:
        joint.range = [-joint.range[1], -joint.range[0]]
        joint.springref, joint.ref, joint.stiffness[1] = -joint.springref, -joint.ref, -joint.stiffness[1]
        for actuator in spec.actuators:
            if actuator.target == joint.name:
                actuator.biasprm[0] = -actuator.biasprm[0]
                actuator.forcerange = [-actuator.forcerange[1], -actuator.forcerange[0]]
                actuator.ctrlrange = [-actuator.ctrlrange[1], -actuator.ctrlrange[0]]
    joint.axis = lateral
    return str(joint.name)


def _keep_actuators(spec: mujoco.MjSpec, body_of: dict[str, str], actuation: str) -> None:
    """Keep the actuator of each hinge, named after its body; `torque` makes its gain the largest torque."""
    kept: dict[str, Any] = {}
    for actuator in list(spec.actuators):
        joint = actuator.target
        if joint not in body_of:
            spec.delete(actuator)
            continue
        if body_of[joint] in kept:
            raise ConfigurationError(f"humanoid.xml: joint {joint} has more than one actuator; needed: one")
        kept[body_of[joint]] = actuator
        if actuation == "torque":
            _drive_by_torque(actuator)
        if not _is_limited(actuator):
            actuator.ctrllimited, actuator.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, _CONTROLS
    without = sorted(joint for joint, body in body_of.items() if body not in kept)
    if without:
        raise ConfigurationError(f"humanoid.xml: joint {without[0]} has no actuator")
    _rename(kept)
    for name, actuator in kept.items():
        actuator.target = name


def _drive_by_torque(actuator: mujoco.MjsActuator) -> None:
    """A control of -1 and 1 is the largest torque, a motor's at rest; the weaker direction stays within its own."""
    largest = np.abs(actuator.forcerange).max()
    if actuator.gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR and actuator.gainprm[7] > 0:
        resistance, constant, voltage = actuator.gainprm[[0, 1, 7]]
        largest = min(largest, constant / resistance * voltage)
    if not actuator.forcerange[1] > 0:
        raise ConfigurationError(
            f"humanoid.xml: joint {actuator.target}'s actuator has no largest torque; "
            "needed for humanoid.actuation=torque: a forcerange that ends above 0"
        )
    actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE
    actuator.dyntype = mujoco.mjtDyn.mjDYN_NONE
    actuator.ctrllimited, actuator.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, _CONTROLS
    actuator.gainprm[0] = largest
    actuator.biasprm[:3] = 0.0


def _is_limited(actuator: mujoco.MjsActuator) -> bool:
    automatic = actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_AUTO
    return bool(np.any(actuator.ctrlrange)) if automatic else actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_TRUE


def _add_root(root: mujoco.MjsBody, skeleton: Skeleton) -> None:
    """Slides along world x and z and a hinge about world y, in the root's frame."""
    root.pos, root.quat = [0, 0, 0], skeleton.base_quaternion
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for name, kind, world in zip(ROOT_JOINTS, (slide, slide, hinge), (0, 2, 1), strict=True):
        joint = root.add_joint(name=name, type=kind, axis=skeleton.base_rotation[world])
        joint.damping, joint.stiffness, joint.armature = np.zeros(3), np.zeros(3), 0.0
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
