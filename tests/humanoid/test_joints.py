"""Strength, passive moments and stops of the own body's joints, by the sources' equations and in the built model."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

from romgrl.humanoid import joints
from romgrl.humanoid.joints import (
    ANKLE_STRENGTH,
    ECCENTRIC,
    HIP_STRENGTH,
    JOINTS,
    KNEE_STRENGTH,
    Joint,
    motor,
    spring,
)
from romgrl.humanoid.model import build
from romgrl.humanoid.skeleton import SMPL
from romgrl.humanoid.task import controls

HEIGHT, MASS = 1.70, 71.8
STRENGTHS = {"Hip": HIP_STRENGTH, "Knee": KNEE_STRENGTH, "Ankle": ANKLE_STRENGTH}
DIRECTIONS = [(name, end) for name in STRENGTHS for end in (0, 1)]
LEGS = [joint for joint in SMPL.hinges if joint[2:] in STRENGTHS]


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build(height=HEIGHT, mass=MASS)


def force(model: mujoco.MjModel, joint: str, angle: float, speed: float, action: float) -> float:
    """Torque of the servo of one joint, N m; nothing else moves."""
    data = mujoco.MjData(model)
    data.joint(joint).qpos[0], data.joint(joint).qvel[0] = angle, speed
    index = model.actuator(joint).id
    data.ctrl[index] = controls(model, np.full(model.nu, action))[index]
    mujoco.mj_forward(model, data)
    return float(data.actuator_force[index])


@pytest.mark.parametrize(
    ("name", "end", "torque"),
    [
        ("Hip", 0, 195.2),
        ("Hip", 1, 310.1),
        ("Knee", 0, 291.0),
        ("Knee", 1, 140.1),
        ("Ankle", 0, 51.5),
        ("Ankle", 1, 166.4),
    ],
)
def test_isometric_torques_of_a_strong_young_man(name: str, end: int, torque: float) -> None:
    """(mean + 2 deviations) x weight x height by Anderson's table 3, for 1.70 m and 71.8 kg: 1197.4 N m."""
    strength = STRENGTHS[name][end]
    assert strength.isometric(HEIGHT, MASS) == pytest.approx(torque, abs=0.05)
    assert strength.share(np.zeros(1)) == pytest.approx([1.0])


@pytest.mark.parametrize(("name", "end"), DIRECTIONS)
def test_strength_falls_with_speed_as_andersons(name: str, end: int) -> None:
    strength = STRENGTHS[name][end]
    speeds = np.array([strength.three_quarters, strength.half])
    assert strength.share(speeds) == pytest.approx([0.75, 0.5])
    curve = strength.share(np.linspace(-20, 20, 401))
    assert (np.diff(curve) <= 1e-12).all()
    assert curve.max() == pytest.approx(ECCENTRIC)
    assert 0.0 <= curve.min() < 0.3
    assert strength.share(np.array([-0.5 * strength.half])) == pytest.approx([1 + 0.5 * (ECCENTRIC - 1)])


@pytest.mark.parametrize("name", STRENGTHS)
def test_the_motor_is_the_line_nearest_to_the_curve(name: str) -> None:
    """Of the stronger direction: no other line has a smaller squared error over the fitted speeds."""
    forward, backward = STRENGTHS[name]
    drive = motor(forward, backward, HEIGHT, MASS)
    low, high = forward.isometric(HEIGHT, MASS), backward.isometric(HEIGHT, MASS)
    stronger, weaker = max(low, high), min(low, high)
    assert sorted((-drive.low, drive.high)) == pytest.approx([weaker, ECCENTRIC * stronger])
    assert (-drive.low < drive.high) == (low < high)
    assert 0.8 * max(low, high) < drive.stall < 1.05 * max(low, high)
    assert 10.0 < drive.no_load < 14.0
    speeds = joints.FITTED_SPEEDS
    lines = [np.polyfit(speeds, strength.share(speeds), 1) for strength in (forward, backward)]
    for strength, line in zip((forward, backward), lines, strict=True):
        error = np.polyval(line, speeds) - strength.share(speeds)
        assert abs(error.mean()) < 1e-12
        assert abs((error * speeds).mean()) < 1e-12
        assert np.sqrt((error**2).mean()) < 0.2
    assert drive.no_load == pytest.approx(max(np.roots(line)[0] for line in lines))


@pytest.mark.parametrize("joint", LEGS)
@pytest.mark.parametrize("sign", [-1, 1])
def test_torque_of_the_built_model_is_the_motors_line(model: mujoco.MjModel, joint: str, sign: int) -> None:
    """Asked for more than it has, it gives stall (1 - speed / no load), and never more than the eccentric limit."""
    limits, drive = JOINTS[joint[2:]], motor(*STRENGTHS[joint[2:]], HEIGHT, MASS)
    # far from the target, so that the servo asks for all there is; the other end of the range may be passed here
    angle = -sign * 3.0
    for speed in (-25.0, -10.0, -4.0, 0.0, 1.0, 4.0, 8.0, 10.0):
        line = drive.stall * (1 - speed / drive.no_load)
        # against the motion the controller asks for no more than its stiffness times the error, or the back-EMF
        asked = limits.stiffness * abs(limits.neutral + sign * limits.reach - angle)
        cap = abs(drive.high if sign > 0 else drive.low)
        expected = min(max(min(asked, line), drive.stall * (-1 - speed / drive.no_load)), cap)
        assert sign * force(model, joint, angle, sign * speed, sign) == pytest.approx(expected, rel=1e-3), speed
    assert sign * force(model, joint, angle, -200.0 * sign, sign) == pytest.approx(cap)


@pytest.mark.parametrize("joint", LEGS)
def test_a_servo_near_its_target_is_a_spring(model: mujoco.MjModel, joint: str) -> None:
    limits = JOINTS[joint[2:]]
    for error in (-0.05, 0.02):
        torque = force(model, joint, limits.neutral - error, 0.0, 0.0)
        assert torque == pytest.approx(limits.stiffness * error, rel=1e-6)


@pytest.mark.parametrize("name", STRENGTHS)
def test_passive_moments_are_near_riener_and_edrichs(name: str) -> None:
    """RMS over the range within 5% of the largest moment, nowhere further off than 22% of it (at an end)."""
    joint = JOINTS[name]
    angles, moment = moments(joint)
    assert joint.passive is not None
    measured = joint.passive(angles)
    error, largest = moment - measured, np.abs(measured).max()
    assert np.sqrt((error**2).mean()) < 0.05 * largest
    assert np.abs(error).max() < 0.22 * largest
    assert np.abs(error)[20:-20].max() < 0.08 * largest


def moments(joint: Joint) -> tuple[np.ndarray, np.ndarray]:
    (a, b, c), rest = spring(joint)
    angles = np.linspace(joint.low, joint.high, 200)
    x = angles - rest
    return angles, -(a * x + b * x**2 + c * x**3)


def test_equations_at_angles_worked_out_by_hand() -> None:
    """Riener and Edrich (1999), in degrees and N m: hip at 0 and knee at 40, knee at 60 and hip at 20, ankle at 0."""
    hip = -(np.exp(1.4655 - 0.136) - np.exp(1.3403 - 0.904) + 8.072)
    assert joints.hip_moment(np.zeros(1)) == pytest.approx([hip])
    assert hip == pytest.approx(-10.30, abs=0.01)
    assert joints.knee_moment(np.radians([60.0])) == pytest.approx([-3.97], abs=0.01)
    assert joints.ankle_moment(np.zeros(1)) == pytest.approx([2.25], abs=0.01)


@pytest.mark.parametrize("name", STRENGTHS)
def test_passive_moments_point_back_into_the_range(name: str) -> None:
    """At both ends and the outer tenths; in between they are small (below 5 N m) wherever they point outward."""
    joint = JOINTS[name]
    angles, moment = moments(joint)
    _, rest = spring(joint)
    assert joint.low < rest < joint.high
    assert (moment[:20] > 0).all()
    assert (moment[-20:] < 0).all()
    outward = moment * (angles - rest) > 0
    assert np.abs(moment[outward]).max(initial=0.0) < 5.0


def test_the_built_model_has_these_moments(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    for name in STRENGTHS:
        angles, moment = moments(JOINTS[name])
        for angle, expected in zip(angles[::40], moment[::40], strict=True):
            data.joint(f"R_{name}").qpos[0] = angle
            mujoco.mj_forward(model, data)
            assert data.joint(f"R_{name}").qfrc_passive[0] == pytest.approx(expected, rel=1e-6), name


@pytest.mark.parametrize("end", [0, 1], ids=["low", "high"])
def test_stops_hold_within_two_degrees_under_the_largest_torque(model: mujoco.MjModel, end: int) -> None:
    """Every joint alone, without weight, pressed against its stop for half a second from a rest at it."""
    free = copy.copy(model)
    free.opt.gravity[:] = 0.0
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
    for joint in SMPL.hinges:
        strength, torque = JOINTS[joint.split("_")[-1]].strength, abs(model.actuator(joint).forcerange[end])
        at_rest = torque if isinstance(strength, float) else min(torque, motor(*strength, HEIGHT, MASS).stall)
        assert max(beyond_the_stop(free, joint, end, at_rest)) < 2.0, joint
        assert beyond_the_stop(free, joint, end, torque)[-1] < 0.5, joint  # eccentric: no stop sees it


def beyond_the_stop(model: mujoco.MjModel, joint: str, end: int, torque: float) -> list[float]:
    """Degrees beyond the end of the range, of a torque towards it from rest at that end."""
    data = mujoco.MjData(model)
    data.qpos[1], data.qpos[3:] = 5.0, model.jnt_range[3:].mean(axis=1)
    index, stop, outward = model.joint(joint).dofadr[0], model.joint(joint).range[end], 2 * end - 1
    data.qpos[index], data.qfrc_applied[index] = stop, outward * torque
    beyond = []
    for _ in range(240):
        mujoco.mj_step(model, data)
        beyond.append(max(0.0, float(np.degrees(outward * (data.qpos[index] - stop)))))
    return beyond


@pytest.mark.parametrize("seed", range(3))
def test_mirrored_states_move_as_mirror_images(model: mujoco.MjModel, seed: int) -> None:
    generator, mirror = np.random.default_rng(seed), SMPL.mirror_joints()
    data, image = mujoco.MjData(model), mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = generator.uniform(-0.4, 0.4, 24), generator.uniform(-2, 2, 24)
    data.qpos[1] = 0.9
    action = generator.uniform(-1, 1, 21)
    image.qpos[:], image.qvel[:] = mirror.image(data.qpos), mirror.image(data.qvel)
    data.ctrl[:], image.ctrl[:] = controls(model, action), controls(model, SMPL.mirror_action().image(action))
    mujoco.mj_step(model, data, nstep=16)
    mujoco.mj_step(model, image, nstep=16)
    assert image.qpos == pytest.approx(mirror.image(data.qpos), abs=1e-6)
    assert np.abs(image.qpos - data.qpos).max() > 1e-3


def test_an_action_is_a_share_of_the_controls(model: mujoco.MjModel) -> None:
    low, high = model.actuator_ctrlrange.T
    rows = controls(model, np.array([-1.0, 0.0, 1.0, -7.0, 7.0, 0.5])[:, None] * np.ones(21))
    assert rows == pytest.approx(np.stack([low, 0.5 * (low + high), high, low, high, 0.25 * low + 0.75 * high]))
    neutral = [JOINTS[name.split("_")[-1]].neutral for name in SMPL.hinges]
    assert controls(model, np.zeros(21)) == pytest.approx(neutral)
    torque = build(actuation="torque")
    assert controls(torque, np.linspace(-1, 1, 21)) == pytest.approx(np.linspace(-1, 1, 21))
