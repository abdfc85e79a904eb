"""The project's own humanoid as a MuJoCo specification: a standing body with a free root and one hinge per segment."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from romgrl.humanoid.anthropometry import (
    ANKLE_HEIGHT,
    DE_LEVA,
    DE_LEVA_HEIGHT,
    HIP_HALF_WIDTH,
    SHOULDER_HALF_WIDTH,
    SHOULDER_HEIGHT,
    mass_fraction,
)
from romgrl.humanoid.joints import JOINTS, motor, spring
from romgrl.humanoid.skeleton import SMPL

TORSO_RGBA, LEFT_RGBA, RIGHT_RGBA = (0.36, 0.48, 0.62, 1), (0.85, 0.52, 0.30, 1), (0.30, 0.60, 0.52, 1)
SOLE_RADIUS = 0.02
FRICTION_STIFFNESS = 10.0
"""Of friction over that of the normal force: what is loaded hardly creeps."""
STOP_SOLREF, STOP_SOLIMP = (0.006, 1.0), (0.95, 0.99, 0.01, 0.5, 2.0)
"""Stops of the joints: as stiff as the physics rate allows, without rebound."""
SOLE_SOLREF, SOLE_SOLIMP = (0.015, 1.0), (0.7, 0.97, 0.01, 0.5, 2.0)
SOLE_SOLREF_FRICTION = (0.006, 1.0)
"""A heel pad and a shoe give by about a centimetre under two body weights, and do not rebound."""
HEEL, BALL = -0.25, 0.47
"""Heel and ball of the foot, forward of the ankle, as shares of the foot length (Winter: ankle at a quarter)."""


def human_spec(*, height: float, mass: float) -> mujoco.MjSpec:
    """A standing person of that height (m) and mass (kg), arms hanging, with position servos."""
    spec = mujoco.MjSpec()
    spec.modelname = "romgrl humanoid"
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = FRICTION_STIFFNESS
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    floor.contype = floor.conaffinity = 0
    offsets = _offsets(height)
    pelvis = spec.worldbody.add_body(name="Pelvis", quat=SMPL.base_quaternion)
    pelvis.add_freejoint(name="Pelvis")
    bodies = {"Pelvis": pelvis}
    for name, parent in SMPL.parents.items():
        bodies[name] = bodies[parent].add_body(name=name, pos=offsets[name])
        if name in SMPL.hinges:
            _add_hinge(spec, bodies[name], height, mass)
    for name in SMPL.bodies:
        _add_inertia(bodies[name], height, mass)
        _add_geoms(spec, bodies[name], height)
    return spec


def _offsets(height: float) -> dict[str, list[float]]:
    """Joint of each body in its parent's frame (left, up, forward), m, standing with the arms down."""
    scale = height / DE_LEVA_HEIGHT
    length = {name: segment.length * scale for name, segment in DE_LEVA.items()}
    pelvis_above_hip = length["lower_trunk"] * (1 - DE_LEVA["lower_trunk"].centre)
    hip_height = length["thigh"] + length["shank"] + ANKLE_HEIGHT * height
    xiphion = hip_height + length["lower_trunk"] + length["middle_trunk"]
    neck_length = height - xiphion - length["upper_trunk"] - length["head"]
    thorax_up = length["upper_trunk"] * (1 - DE_LEVA["upper_trunk"].centre)
    thorax_out = 0.3 * SHOULDER_HALF_WIDTH * height
    central: dict[str, Sequence[float]] = {
        "Torso": (0, length["lower_trunk"] - pelvis_above_hip, 0),
        "Spine": (0, length["middle_trunk"] / 2, 0),
        "Chest": (0, length["middle_trunk"] / 2, 0),
        "Neck": (0, length["upper_trunk"], 0),
        "Head": (0, neck_length, 0),
    }
    left: dict[str, Sequence[float]] = {
        "Hip": (HIP_HALF_WIDTH * height, -pelvis_above_hip, 0),
        "Knee": (0, -length["thigh"], 0),
        "Ankle": (0, -length["shank"], 0),
        "Toe": (0, -ANKLE_HEIGHT * height + SOLE_RADIUS, BALL * length["foot"]),
        "Thorax": (thorax_out, thorax_up, 0),
        "Shoulder": (SHOULDER_HALF_WIDTH * height - thorax_out, SHOULDER_HEIGHT * height - xiphion - thorax_up, 0),
        "Elbow": (0, -length["upper_arm"], 0),
        "Wrist": (0, -length["forearm"], 0),
        "Hand": (0, -length["hand"], 0),
    }
    sides = {"L": 1, "R": -1}
    return {name: list(offset) for name, offset in central.items()} | {
        f"{side}_{name}": [sign * offset[0], *offset[1:]]
        for name, offset in left.items()
        for side, sign in sides.items()
    }


def _add_hinge(spec: mujoco.MjSpec, body: mujoco.MjsBody, height: float, mass: float) -> None:
    """A pitch hinge with its passive moment and stiff stops, and a servo towards the angle that its control names."""
    joint = JOINTS[body.name.split("_", 1)[-1]]
    hinge = body.add_joint(name=body.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[1, 0, 0])
    hinge.range, hinge.limited = np.degrees([joint.low, joint.high]), mujoco.mjtLimited.mjLIMITED_TRUE
    hinge.solref_limit, hinge.solimp_limit = STOP_SOLREF, STOP_SOLIMP
    hinge.damping[0], hinge.armature = joint.damping, joint.armature
    hinge.stiffness, rest = spring(joint)
    hinge.springref = np.degrees(rest)
    servo = spec.add_actuator(name=hinge.name, target=hinge.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.ctrllimited, servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE, mujoco.mjtLimited.mjLIMITED_TRUE
    servo.ctrlrange = [joint.neutral - joint.reach, joint.neutral + joint.reach]
    if isinstance(joint.strength, float):
        servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        servo.gainprm[0], servo.biasprm[1] = joint.stiffness, -joint.stiffness
        servo.forcerange = [-joint.strength, joint.strength]
        return
    drive = motor(*joint.strength, height, mass)
    servo.set_to_dcmotor(
        motorconst=[0, 0],
        resistance=0,
        nominal=[1.0, drive.stall, drive.no_load],
        controller=[joint.stiffness, 0, 0, 0, 0, 1.0],
        ctrlspec=mujoco.mjtCtrlInput.mjINPUT_POS.value,
    )
    servo.forcerange = [drive.low, drive.high]


def _add_inertia(body: mujoco.MjsBody, height: float, mass: float) -> None:
    """Mass, centre of mass and moments of inertia: de Leva's for whole segments, a uniform box for shared ones."""
    scale = height / DE_LEVA_HEIGHT
    limb = body.name.split("_", 1)[-1]
    whole = {"Hip": "thigh", "Knee": "shank", "Shoulder": "upper_arm", "Elbow": "forearm", "Pelvis": "lower_trunk"}
    body.explicitinertial = True
    body.mass = mass * mass_fraction(body.name)
    if limb in whole:
        segment = DE_LEVA[whole[limb]]
        length = segment.length * scale
        body.ipos = [0, 0 if limb == "Pelvis" else -segment.centre * length, 0]
        sagittal, transverse, longitudinal = (body.mass * (radius * length) ** 2 for radius in segment.gyration)
        body.inertia = [transverse, longitudinal, sagittal]
        return
    centre, size = _box(limb, height)
    body.ipos = centre
    square = np.square(size)
    body.inertia = body.mass / 12 * (square.sum() - square)


def _box(limb: str, height: float) -> tuple[list[float], list[float]]:
    """Centre and full size (left, up, forward), m, of the box that a part of a segment fills."""
    scale = height / DE_LEVA_HEIGHT
    length = {name: segment.length * scale for name, segment in DE_LEVA.items()}
    foot, ankle = length["foot"], ANKLE_HEIGHT * height
    middle, upper, hand = length["middle_trunk"] / 2, length["upper_trunk"], length["hand"]
    thorax_up = upper * (1 - DE_LEVA["upper_trunk"].centre)
    toe = 1 + HEEL - BALL
    boxes = {
        "Torso": ((0, middle / 2, 0), (0.30, middle, 0.20)),
        "Spine": ((0, middle / 2, 0), (0.30, middle, 0.20)),
        "Chest": ((0, thorax_up, 0), (0.32, upper, 0.21)),
        "Thorax": ((0, 0, 0), (0.12, 0.10, 0.12)),
        "Neck": ((0, 0.04, 0), (0.12, 0.09, 0.12)),
        "Head": ((0, length["head"] * (1 - DE_LEVA["head"].centre), 0.01), (0.15, 0.22, 0.19)),
        "Wrist": ((0, -hand / 2, 0), (0.03, hand, 0.08)),
        "Hand": ((0, -hand / 2, 0), (0.025, hand, 0.07)),
        "Ankle": ((0, -ankle / 2, (BALL + HEEL) / 2 * foot), (0.08, ankle, (BALL - HEEL) * foot)),
        "Toe": ((0, 0, toe / 2 * foot), (0.08, 2 * SOLE_RADIUS, toe * foot)),
    }
    centre, size = boxes[limb]
    return list(centre), list(size)


def _add_geoms(spec: mujoco.MjSpec, body: mujoco.MjsBody, height: float) -> None:
    """Shapes without mass. Only the floor is touched; in the plane a sole is its heel, its ball and the tip of the toe,
    so spheres stand for the edges of the boxes and halve the number of contacts. Each is an explicit pair with the
    floor: there is nothing to search for in every step.
    """
    scale = height / DE_LEVA_HEIGHT
    limb = body.name.split("_", 1)[-1]
    rgba = LEFT_RGBA if body.name.startswith("L_") else RIGHT_RGBA if body.name.startswith("R_") else TORSO_RGBA
    look = {"rgba": rgba, "mass": 0.0, "contype": 0, "conaffinity": 0}
    foot, ankle = DE_LEVA["foot"].length * scale, ANKLE_HEIGHT * height
    limbs = {
        "Hip": ("thigh", 0.075),
        "Knee": ("shank", 0.050),
        "Shoulder": ("upper_arm", 0.042),
        "Elbow": ("forearm", 0.034),
    }
    if limb in limbs:
        segment, radius = limbs[limb]
        end = [0, -DE_LEVA[segment].length * scale, 0]
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, *end], size=[radius, 0, 0], **look)
    elif limb in ("Head", "Pelvis", "Torso", "Spine", "Chest", "Thorax", "Neck"):
        centre, size = ([0, 0, 0], [0.31, 0.24, 0.21]) if limb == "Pelvis" else _box(limb, height)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, pos=centre, size=_rounded(limb, size), **look)
    else:
        centre, size = _box(limb, height)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=[edge / 2 for edge in size], **look)
    soles = {
        "Ankle": (
            ("heel", -ankle + SOLE_RADIUS, HEEL * foot + SOLE_RADIUS),
            ("ball", -ankle + SOLE_RADIUS, BALL * foot),
        ),
        "Toe": (("tip", 0, (1 + HEEL - BALL) * foot - SOLE_RADIUS),),
        "Knee": (("knee", 0, 0.03),),
    }
    for part, up, forward in soles.get(limb, ()):
        sole = body.add_geom(name=f"{body.name}_{part}", type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=[0, up, forward])
        sole.size, sole.mass, sole.rgba = [SOLE_RADIUS, 0, 0], 0.0, rgba
        sole.contype = sole.conaffinity = 0
        pair = spec.add_pair(geomname1="floor", geomname2=sole.name)
        pair.solref, pair.solimp, pair.solreffriction = SOLE_SOLREF, SOLE_SOLIMP, SOLE_SOLREF_FRICTION


def _rounded(limb: str, size: Sequence[float]) -> list[float]:
    """Half axes of an ellipsoid that fills the box and overlaps its neighbours, so that the trunk looks closed."""
    stretch = {"Torso": 2.1, "Spine": 2.2, "Chest": 1.7, "Neck": 1.9}.get(limb, 1.0)
    return [size[0] / 2 * 1.05, size[1] / 2 * stretch, size[2] / 2 * 1.05]
