"""Feet that roll on an arc: the pendulum on an arc, friction worked by hand, the balance of energy, engines alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from romgrl.rom import _core
from romgrl.rom.observation import MOTOR_ACTION_NAMES, MOTOR_OBSERVATION_NAMES, mirror
from romgrl.rom.parameters import SpringLegParameters, VariableLegParameters, unfit_parameters
from romgrl.rom.vector_env import SpringLegVectorEnv
from tests.helpers.rom_worlds import FEET, GRAVITY, MOTOR, WALKER, Worlds, core_parameters, passive, pose, run

LENGTH, RADIUS, MASS, LIGHT = 0.865, 0.072, 71.8, 0.05
each_engine = pytest.mark.usefixtures("engine")
each_radius = pytest.mark.parametrize("radius", [RADIUS, 0.2, 0.35])
Array = NDArray[Any]


def rolling(angle: float, rate: float, radius: float) -> tuple[Array, Array]:
    """Velocities of hip and foot of a rigid leg that rolls: the arc's lowest point stands still."""
    offset = radius - RADIUS
    foot = -rate * np.array([radius - offset * np.cos(angle), -offset * np.sin(angle)])
    return foot - LENGTH * rate * np.array([np.cos(angle), np.sin(angle)]), foot


def vault(angle: float, rate: float, radius: float, times: Array) -> Array:
    """Angle and rate (2, T) of a rigid massless leg with trunk and foot as points, in front by `angle`, rolling.

    Lagrange's equation of the one coordinate: I(a) a'' + I'(a) a'^2 / 2 = -V'(a), with I from the velocities at a' = 1.
    The other foot counts to the trunk.
    """

    def inertia(at: float) -> float:
        hip, foot = rolling(at, 1.0, radius)
        return float((MASS - LIGHT) * hip @ hip + LIGHT * foot @ foot)

    def slope(at: float) -> float:  # of the potential: height of the hip (L - d) cos a + R, of the foot R - d cos a
        offset = radius - RADIUS
        return GRAVITY * np.sin(at) * float(LIGHT * offset - (MASS - LIGHT) * (LENGTH - offset))

    def rates(_: float, state: Array) -> list[float]:
        half = (inertia(state[0] + 1e-6) - inertia(state[0] - 1e-6)) / 4e-6
        return [state[1], -(slope(state[0]) + half * state[1] ** 2) / inertia(state[0])]

    return np.asarray(solve_ivp(rates, (0.0, times[-1]), [angle, rate], t_eval=times, rtol=1e-10, atol=1e-12).y)


def vaulting(angle: float, rate: float, radius: float) -> tuple[_core.Parameters, Any]:
    """Parameters and pose of a leg so stiff that it is rigid, on feet of hardly a weight; the other is in the air."""
    stiff = {"stiffness": 1e6, "stance_damping": 100.0, "swing_damping": 100.0, "friction": 50.0, "foot_mass": LIGHT}
    stiff |= {"hip_angle_limit": 1.57, "trunk_moment_limit": 0.0, "control_frequency": 4800.0}
    stiff |= {"roll_over_radius": radius}
    hip, foot = rolling(angle, rate, radius)
    along = np.array([np.sin(angle), -np.cos(angle)])
    height = (LENGTH - radius + RADIUS) * np.cos(angle) + radius - 1e-6
    start = pose(y=height, vx=hip[0], vy=hip[1], hip_angle=(angle, -1.5))
    start.hip_rate, start.leg_rate = (rate, 0.0), (float((foot - hip) @ along), 0.0)
    return passive(**stiff), start


@each_engine
@each_radius
def test_a_rigid_leg_vaults_as_lagrange_says(radius: float) -> None:
    """Angle to 1 mrad and height to 1.5 mm, by 1 of which the spring gives, over 0.35 s; no slip of 0.1 mm."""
    angle, rate, steps = 0.35, -1.6, 1680
    parameters, start = vaulting(angle, rate, radius)
    trunk, feet = run(parameters, start, steps)
    away = feet[:, 0, :2] - trunk[:, :2]
    found = np.arctan2(away[:, 0], -away[:, 1])
    offset = radius - RADIUS
    rolled = feet[:, 0, 0] - offset * np.sin(found) + radius * found
    assert np.abs(rolled - rolled[0]).max() < 1e-4
    expected = vault(angle, rate, radius, np.arange(steps + 1) / 4800.0)
    height = (LENGTH - offset) * np.cos(expected[0]) + radius
    assert found[-1] < -0.09
    np.testing.assert_allclose(found, expected[0], rtol=0, atol=1e-3)
    np.testing.assert_allclose(trunk[:, 1], height, rtol=0, atol=1.5e-3)


@each_engine
@pytest.mark.parametrize(("friction", "slides"), [(0.3, True), (50.0, False)])
def test_the_impulse_of_the_ground_by_hand(friction: float, slides: bool) -> None:
    """No forces but the ground's: what foot and trunk gain is (T, N) + C t and -C t, and the lowest point stops.

    C is the moment of (T, N) about the leg's end over the leg's length; a foot that slides has |T| = mu N.
    """
    radius, foot, angle = 0.3, 2.0, 0.4
    values = {"gravity": 0.0, "friction": friction, "trunk_moment_limit": 0.0, "foot_mass": foot}
    worlds = Worlds(passive(roll_over_radius=radius, **values))
    offset, along = radius - RADIUS, np.array([np.sin(angle), -np.cos(angle)])
    across = np.array([-along[1], along[0]])
    arm = np.array([0.0, -radius]) - offset * along  # from the leg's end to the lowest point
    height = (LENGTH - offset) * np.cos(angle) + radius - 1e-5
    worlds.batch.place(0, pose(y=height, vx=1.5, vy=-0.5, hip_angle=(angle, -angle - 0.3)))
    before = np.vstack((worlds.trunk(), worlds.feet()))[:, 3:5]
    worlds.step()
    after = np.vstack((worlds.trunk(), worlds.feet()))[:, 3:5]
    trunk, given = (MASS - 2 * foot) * (after[0] - before[0]), foot * (after[1] - before[1])
    couple = -float(trunk @ across)
    tangent, normal = given - couple * across
    assert trunk == pytest.approx(-couple * across, abs=2e-5)
    assert couple == pytest.approx((arm[0] * normal - arm[1] * tangent) / LENGTH, rel=1e-3)
    assert normal == pytest.approx(float(worlds["ground_force"][0, 0]) / 480.0, rel=1e-4)
    turning = float((after[1] - after[0]) @ across) / LENGTH
    point = after[1] + turning * np.array([-arm[1], arm[0]])
    assert point[1] == pytest.approx(0.0, abs=1e-5)
    assert (point[0] > 0.1) == slides
    assert tangent == pytest.approx(-friction * normal, rel=1e-4) if slides else point[0] == pytest.approx(0, abs=1e-5)
    assert after[2] == pytest.approx(before[2], abs=1e-6)


@each_engine
def test_episodes_begin_with_a_foot_that_rolls() -> None:
    """The front foot touches the ground, and its lowest point stands still; the rear one is as high."""
    radius = 0.3
    worlds = Worlds(core_parameters(roll_over_radius=radius), 100)
    worlds.batch.seed(0)
    worlds.batch.reset()
    worlds.batch.observe(worlds["observation"], worlds["features"], worlds["contact"])
    assert worlds["contact"].all()
    for state in worlds.batch.save():
        hip, foot = state[[0, 1, 3, 4]], state[FEET[0]][[0, 1, 3, 4]]  # slot 0 has the front leg
        along = (foot - hip)[:2] / LENGTH
        across, offset = np.array([-along[1], along[0]]), radius - RADIUS
        assert along[0] > 0
        turning = float((foot - hip)[2:] @ across) / LENGTH
        point = foot[2:] + turning * np.array([radius + offset * along[1], -offset * along[0]])
        assert point == pytest.approx([0, 0], abs=1e-5)
        assert foot[1] - offset * along[1] - radius == pytest.approx(-1e-4, abs=1e-6)


@pytest.mark.parametrize("friction", [0.3, 1.0])
@pytest.mark.parametrize("leg", [{}, MOTOR])
def test_the_engines_are_alike(friction: float, leg: dict[str, Any]) -> None:
    """From the same state with the same action, substep by substep, at the stops, too: to 1e-4 in SI units.

    But for one world-step in two thousand, where rounding decides if a leg is loaded.
    """
    radius, rng = 0.3, np.random.default_rng(7)
    values = dict(leg, control_frequency=480.0, substeps=1, episode_steps=10**6, fall_height=0.0)
    values |= {"roll_over_radius": radius, "friction": friction, "trunk_locked": False, "trunk_pitch_limit": 10.0}
    box2d, native = (Worlds(core_parameters(engine_is_native=own, **values), 200) for own in (False, True))
    for world in range(200):
        angle, length = rng.uniform(-1.2, 1.2, 2), rng.uniform(0.6, 0.9, 2)
        height = float(((length - radius + RADIUS) * np.cos(angle)).max() + radius + rng.uniform(-0.03, 0.05))
        rates = {"hip_rate": rng.uniform(-15.0, 15.0, 2), "leg_rate": rng.uniform(-8.0, 8.0, 2)}
        box2d.batch.place(world, pose(y=height, vx=rng.uniform(0, 5), hip_angle=angle, leg_length=length, **rates))
    errors, forces, strain, touched = [], [], 0.0, 0.0
    for _ in range(150):
        native.batch.restore(box2d.batch.save())
        action = rng.uniform(-1, 1, (200, native.batch.action_size)).astype(np.float32)
        for worlds in (box2d, native):
            worlds.step(action)
        going = ~(box2d["diverged"] | native["diverged"])
        errors.append(np.abs(native.batch.save() - box2d.batch.save())[going, WALKER].max(axis=1))
        forces.append(np.abs(native["ground_force"] - box2d["ground_force"])[going].max(axis=1))
        strain = max(strain, float(box2d["final_observation"][:, 6:8].max()))
        touched += float(box2d["contact"].mean()) / 150
    assert leg or strain > 0.0499
    assert touched > 0.2
    assert np.quantile(np.concatenate(errors), 0.9995) < 1e-4
    assert np.quantile(np.concatenate(forces), 0.9995) < 1.0


@each_engine
def test_a_mirrored_world_stays_the_mirror_image() -> None:
    observation, action = mirror(MOTOR_OBSERVATION_NAMES), mirror(MOTOR_ACTION_NAMES)
    worlds, others = (Worlds(core_parameters(fall_height=0.0, roll_over_radius=0.3, **MOTOR)) for _ in range(2))
    worlds.batch.place(0, pose(y=0.92, vx=3.0, hip_angle=(0.3, -0.3)))
    others.batch.place(0, pose(y=0.92, vx=3.0, hip_angle=(-0.3, 0.3)))
    rng, touched = np.random.default_rng(3), False
    for _ in range(30):
        chosen = rng.uniform(-1, 1, (1, 4)).astype(np.float32)
        worlds.step(chosen)
        others.step(np.ascontiguousarray(action.image(chosen)))
        touched |= bool(worlds["contact"].all())
        np.testing.assert_array_equal(observation.image(worlds["final_observation"]), others["final_observation"])
    assert touched


@each_engine
def test_threads_and_restored_states_change_no_bit() -> None:
    parameters = core_parameters(roll_over_radius=0.3, episode_steps=40, **MOTOR)
    one, many, other = Worlds(parameters, 37), Worlds(parameters, 37, 3), Worlds(parameters, 37)
    actions = np.random.default_rng(0).uniform(-1, 1, (100, 37, 4)).astype(np.float32)
    for worlds in (one, many):
        worlds.batch.seed(5)
        worlds.batch.reset()
    for step, action in enumerate(actions):
        if step == 33:
            other.batch.restore(one.batch.save())
        for worlds in (one, many, *((other,) if step >= 33 else ())):
            worlds.step(action)
    for worlds in (many, other):
        assert one.batch.save().tobytes() == worlds.batch.save().tobytes()
        assert one["final_observation"].tobytes() == worlds["final_observation"].tobytes()


@pytest.mark.parametrize("radius", [-0.1, 0.05, 0.51, 3.0, np.nan, np.inf])
def test_a_radius_that_cannot_be_is_refused(radius: float) -> None:
    """Less than the circle's, or with its centre above the hip where the leg is shortest: 0.072 + 0.5 x 0.865 m."""
    for parameters in (SpringLegParameters(roll_over_radius=radius), VariableLegParameters(roll_over_radius=radius)):
        with pytest.raises(ValueError, match=r"^roll_over_radius = .* is not between"):
            SpringLegVectorEnv(parameters=parameters)
        assert [name for name, _ in unfit_parameters(parameters, 30.0)] == ["roll_over_radius"]
