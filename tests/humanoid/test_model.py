"""The planar humanoid's anthropometry, symmetry and physics, and a user's own file held in the plane."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from romgrl.errors import ConfigurationError
from romgrl.humanoid.anthropometry import DE_LEVA, MASS_SHARES, mass_fraction
from romgrl.humanoid.joints import HIP_STRENGTH, JOINTS, Joint, motor
from romgrl.humanoid.model import ABILITIES, build, dimensions, fingerprint
from romgrl.humanoid.own_body import human_spec
from romgrl.humanoid.sagittal_plane import hold_in_plane
from romgrl.humanoid.skeleton import SMPL
from romgrl.humanoid.task import controls
from tests.humanoid.files import humenv_xml

SPINE = ("Torso", "Spine", "Chest")
LIMBS = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


def joints_of(model: mujoco.MjModel) -> list[Joint]:
    return [JOINTS[model.joint(index).name.split("_")[-1]] for index in range(3, model.njnt)]


def test_masses_are_de_levas() -> None:
    model = build(height=1.8, mass=80.0)
    assert model.body_mass.sum() == pytest.approx(80.0, abs=1e-9)
    for segment, shares in MASS_SHARES.items():
        names = [name for name, _ in shares]
        if segment in LIMBS:
            names = [f"L_{name}" for name in names]
        mass = sum(model.body(name).mass[0] for name in names)
        assert mass / 80.0 == pytest.approx(DE_LEVA[segment].mass, abs=1e-12), segment
    assert sum(mass_fraction(name) for name in SMPL.bodies) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(ValueError, match="no such body"):
        mass_fraction("Tail")


def test_thigh_has_de_levas_centre_and_inertia() -> None:
    model = build(height=1.741, mass=73.0)
    thigh = model.body("L_Hip")
    assert thigh.ipos == pytest.approx([0, -0.4095 * 0.4222, 0], abs=1e-12)
    assert model.body("L_Knee").pos == pytest.approx([0, -0.4222, 0], abs=1e-12)
    about_lateral = 0.1416 * 73.0 * (0.329 * 0.4222) ** 2
    along = 0.1416 * 73.0 * (0.149 * 0.4222) ** 2
    assert np.sort(thigh.inertia) == pytest.approx([along, about_lateral, about_lateral], rel=1e-9)


def test_dimensions_scale_with_height() -> None:
    size = dimensions(build(height=1.741, mass=73.0))
    above_hip = 0.1457 * (1 - 0.6115)
    assert size.leg_length == pytest.approx(0.4222 + 0.4340 + above_hip, abs=1e-9)
    assert size.ankle_height == pytest.approx(0.039 * 1.741, abs=1e-9)
    assert size.pelvis_height == pytest.approx(size.leg_length + size.ankle_height, abs=1e-9)
    assert size.head_height == pytest.approx(1.741 - 0.2033, abs=1e-9)
    double = dimensions(build(height=2 * 1.741, mass=10.0))
    assert double.mass == pytest.approx(10.0)
    assert double.leg_length == pytest.approx(2 * size.leg_length)


def test_tree_and_degrees_of_freedom() -> None:
    model = build()
    assert (model.nq, model.nv, model.nu) == (24, 24, 21)
    assert [model.body(index).name for index in range(1, 25)] == list(SMPL.bodies)
    for name, parent in SMPL.parents.items():
        assert model.body(model.body(name).parentid[0]).name == parent
    assert [model.joint(index).name for index in range(3, 24)] == list(SMPL.hinges)
    targets = [[joint.neutral - joint.reach, joint.neutral + joint.reach] for joint in joints_of(model)]
    assert model.actuator_ctrlrange == pytest.approx(np.array(targets))
    assert model.opt.timestep == pytest.approx(1 / 480)


def test_left_equals_right() -> None:
    model = build()
    for name in SMPL.bodies:
        body, other = model.body(name), model.body(SMPL.other_side(name))
        assert body.pos == pytest.approx(other.pos * [-1, 1, 1], abs=0)
        assert (body.mass[0], *body.inertia) == (other.mass[0], *other.inertia)
    image = SMPL.mirror_joints().permutation
    for name in ("jnt_range", "jnt_stiffness", "jnt_stiffnesspoly", "jnt_solref", "jnt_solimp", "dof_damping"):
        assert np.array_equal(getattr(model, name), getattr(model, name)[image]), name
    assert np.array_equal(model.dof_armature, model.dof_armature[image])
    assert np.array_equal(model.qpos_spring, model.qpos_spring[image])
    image = SMPL.mirror_action().permutation
    for name in ABILITIES:
        if name.startswith("actuator"):
            assert np.array_equal(getattr(model, name), getattr(model, name)[image]), name


def test_hinges_follow_the_sign_convention() -> None:
    model = build()
    data = mujoco.MjData(model)
    for name, body, forward in (("L_Hip", "L_Knee", -1), ("L_Knee", "L_Ankle", -1), ("Torso", "Neck", 1)):
        mujoco.mj_resetData(model, data)
        data.joint(name).qpos[0] = 0.3
        mujoco.mj_kinematics(model, data)
        assert np.sign(data.body(body).xpos[0]) == forward
        assert abs(data.body(body).xpos[1] - data.body(name).xpos[1]) < 1e-12


def test_spine_cannot_fold() -> None:
    ranges = [build().joint(name).range for name in SPINE]
    low, high = np.sum(ranges, axis=0)
    assert low == pytest.approx(-0.9)
    assert high == pytest.approx(1.3)  # lumbar and thoracic spine: about 75 degrees forward and 50 back
    data = mujoco.MjData(build())
    for action in (-1.0, 1.0):  # what the servos ask for is less: 26 degrees either way
        bend = sum(controls(data.model, np.full(21, action))[data.model.actuator(name).id] for name in SPINE)
        assert abs(bend - 0.10) == pytest.approx(0.45)


def test_servo_torque_stays_human() -> None:
    """At rest no servo gives more than the motor's stall torque or the range of its forces, however far it is off."""
    model = build()
    data = mujoco.MjData(model)
    data.joint("L_Hip").qpos[0], data.joint("R_Shoulder").qpos[0] = -2.0, -2.6
    data.ctrl[:] = 1.0
    mujoco.mj_forward(model, data)
    stall = motor(*HIP_STRENGTH, 1.741, 73.0).stall
    assert data.actuator("L_Hip").force[0] == pytest.approx(stall, rel=1e-5)
    assert data.actuator("R_Shoulder").force[0] == pytest.approx(60.0)
    assert np.abs(model.actuator_forcerange).max() == pytest.approx(1.4 * (0.161 + 2 * 0.049) * 73.0 * 9.81 * 1.741)


def test_torque_actuation() -> None:
    """An action is a share of the larger end of the range of torques, or of a motor's torque at rest."""
    servo = build()
    resistance, constant, voltage = servo.actuator_gainprm[:, [0, 1, 7]].T
    motors = servo.actuator_gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR
    at_rest = np.where(motors, constant * voltage / resistance, np.inf)
    model = build(actuation="torque")
    data = mujoco.MjData(model)
    data.qpos[3:] = -0.1
    action = np.linspace(-1, 1, 21)
    data.ctrl[:] = controls(model, action)
    mujoco.mj_forward(model, data)
    low, high = model.actuator_forcerange.T
    largest = np.minimum(np.maximum(-low, high), at_rest)
    assert data.actuator_force == pytest.approx(np.clip(action * largest, low, high))
    assert data.ctrl == pytest.approx(action)


def test_free_fall_and_energy_free_of_contact() -> None:
    model = build()
    data = mujoco.MjData(model)
    data.qpos[1], data.qvel[0] = 10.0, 3.0
    step = model.opt.timestep
    for _ in range(480):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    # semi-implicit integration of a constant acceleration: z = -g t (t + h) / 2, g = 9.81, t = 1 s
    standing = mujoco.MjData(model)
    standing.qpos[1] = 10.0
    mujoco.mj_forward(model, standing)
    drop = data.subtree_com[1, 2] - standing.subtree_com[1, 2]
    assert drop == pytest.approx(-9.81 * (1 + step) / 2, abs=2e-3)
    assert data.subtree_com[1, 0] - standing.subtree_com[1, 0] == pytest.approx(3.0, abs=2e-3)


def landing(substeps: int) -> np.ndarray:
    """State after a third of a second of a drop onto a bent leg."""
    model = build(substeps=substeps)
    data = mujoco.MjData(model)
    data.qpos[1], data.qvel[0] = 1.0, 2.0
    data.joint("R_Knee").qpos[0] = 1.0
    for _ in range(10 * substeps):
        mujoco.mj_step(model, data)
    return data.qpos.copy()


def test_timestep_is_small_enough() -> None:
    difference = np.abs(landing(16) - landing(64))
    assert difference[1] < 0.005
    assert difference[2:].mean() < 0.01


def test_stable_under_random_bang_bang() -> None:
    model, generator = build(), np.random.default_rng(0)
    data = mujoco.MjData(model)
    data.qpos[1] = 1.0
    for _ in range(300):
        data.ctrl[:] = controls(model, generator.choice([-1.0, 1.0], 21))
        for _ in range(16):
            mujoco.mj_step(model, data)
        assert np.abs(data.qvel).max() < 80
    assert sum(warning.number for warning in data.warning) == 0


@pytest.mark.parametrize(
    "bad",
    [{"actuation": "muscle"}, {"height": 0.0}, {"mass": float("nan")}, {"control_frequency": -1}, {"substeps": 0}],
)
def test_bad_arguments(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        build(**bad)


def test_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"humanoid\.xml: no such file") as error:
        build(xml=tmp_path / "robot.xml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text", ["not xml", "<mujoco/>", "<mujoco><worldbody><body name='Pelvis'/></worldbody></mujoco>"]
)
def test_wrong_file_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"humanoid\.xml") as error:
        build(xml=path)
    assert "\n" not in str(error.value)


def test_joint_away_from_its_body_is_refused() -> None:
    spec = human_spec(height=1.741, mass=73.0)
    spec.joint("L_Knee").pos = [0, 0.01, 0]
    with pytest.raises(ConfigurationError, match="L_Knee must be at the origin"):
        hold_in_plane(spec, actuation="servo")


def test_every_sole_touches_the_floor_and_nothing_else() -> None:
    model = build()
    soles = [name for side in "LR" for name in (f"{side}_Knee", f"{side}_Ankle", f"{side}_Toe")]
    touched = {model.body(model.geom_bodyid[geom]).name for geom in model.pair_geom2}
    assert touched == set(soles)
    assert set(model.pair_geom1) == {model.geom("floor").id}
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_the_users_own_humanoid() -> None:
    full = mujoco.MjModel.from_xml_path(str(humenv_xml()))
    model = build(xml=humenv_xml(), substeps=15)
    assert (model.nq, model.nv, model.nu) == (24, 24, 21)
    assert model.opt.timestep == pytest.approx(1 / 450)
    size = dimensions(model)
    assert size.mass == pytest.approx(full.body_mass.sum(), abs=1e-9)
    assert size.leg_length == pytest.approx(0.868, abs=1e-3)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for side in ("L", "R"):
        assert data.body(f"{side}_Wrist").xpos[2] < data.body(f"{side}_Shoulder").xpos[2] - 0.4
        servo, original = model.actuator(f"{side}_Knee"), full.actuator(f"{side}_Knee_x")
        assert servo.gainprm.tolist() == original.gainprm.tolist()
    elbows = [model.joint(f"{side}_Elbow").range.tolist() for side in "LR"]
    assert elbows[0] == pytest.approx(elbows[1])
    axes = data.xaxis[3:]
    assert np.abs(axes - [0, 1, 0]).max() < 1e-9


def test_mirror_of_joints_is_its_own_inverse() -> None:
    permutation = SMPL.mirror_joints().permutation
    assert permutation[permutation].tolist() == list(range(24))


def test_a_fingerprint_knows_the_humanoid_and_what_it_can_do() -> None:
    own = fingerprint(build())
    assert own == fingerprint(build(substeps=32, control_frequency=60.0))
    others = [build(height=1.75), build(mass=73.5), build(actuation="torque")]
    for ability in ABILITIES:
        others.append(build())
        values = getattr(others[-1], ability)
        values[values.nonzero()] *= 1.001
        if not values.any():
            values += 0.001
    assert len({own, *map(fingerprint, others)}) == 1 + len(others)
