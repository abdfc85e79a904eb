"""The mechanics against closed forms and conservation laws."""

import math

import numpy as np
import pytest

from tests.helpers.rom_worlds import GRAVITY, SUBSTEPS_PER_SECOND, Worlds, core_parameters, passive, pose, run

pytestmark = pytest.mark.usefixtures("engine")

DT = 1.0 / SUBSTEPS_PER_SECOND
MASS, FOOT, STIFFNESS, LENGTH, RADIUS = 71.8, 0.9, 24000.0, 0.865, 0.072
TRUNK = MASS - 2 * FOOT


def test_ballistic_flight_follows_the_discrete_law() -> None:
    """Semi-implicit Euler: y_n = y_0 + n v dt - g dt^2 n (n + 1) / 2, to 1e-5 m over half a second."""
    start = pose(y=3.0, vx=3.0, vy=2.0, hip_angle=(0.3, -0.4))
    trunk, feet = run(passive(), start, 240)
    n = np.arange(241)
    y = 3.0 + 2.0 * n * DT - GRAVITY * DT**2 * n * (n + 1) / 2
    np.testing.assert_allclose(trunk[:, 0], 3.0 * n * DT, atol=1e-5)
    np.testing.assert_allclose(trunk[:, 1], y, atol=1e-5)
    np.testing.assert_allclose(feet[:, 0, 1], y - LENGTH * math.cos(0.3), atol=2e-5)


def test_long_run_keeps_its_place_in_the_world() -> None:
    """A frictionless flight of 100 m, which moves Box2D's origin 25 times."""
    parameters = passive(gravity=0.0, control_frequency=30.0, substeps=16)
    trunk, feet = run(parameters, pose(y=3.0, vx=10.0, hip_angle=(0.3, -0.3)), 300)
    np.testing.assert_allclose(trunk[-1, 0], 100.0, atol=1e-3)
    np.testing.assert_allclose(feet[-1, 0, 0] - trunk[-1, 0], LENGTH * math.sin(0.3), atol=5e-4)


def test_static_compression_is_weight_over_stiffness() -> None:
    """Two legs in parallel carry the trunk: compression m g / (2 k), to 1e-4 m; the ground carries the feet too."""
    worlds = Worlds(passive(stance_damping=300.0))
    worlds.batch.place(0, pose(y=LENGTH + RADIUS))
    for _ in range(3 * SUBSTEPS_PER_SECOND):
        worlds.step()
    length = worlds.trunk()[1] - worlds.feet()[:, 1]
    np.testing.assert_allclose(LENGTH - length, TRUNK * GRAVITY / (2 * STIFFNESS), atol=1e-4)
    np.testing.assert_allclose(worlds["ground_force"].sum(), MASS * GRAVITY, rtol=1e-3)
    np.testing.assert_allclose(worlds["observation"][0, 14:16].sum(), TRUNK / MASS, rtol=1e-3)  # leg loads


def test_mean_ground_force_of_hopping_is_the_weight() -> None:
    """Vertical momentum theorem over many hops: mean force = m g + m (v_end - v_start) / T, to 0.1%."""
    worlds = Worlds(passive(swing_damping=140.0))
    worlds.batch.place(0, pose(y=1.1))
    mass = np.array([TRUNK, FOOT, FOOT])

    def momentum() -> float:
        return float(mass @ [worlds.trunk()[4], *worlds.feet()[:, 4]])

    impulse, start, steps = 0.0, momentum(), 10 * SUBSTEPS_PER_SECOND
    for _ in range(steps):
        worlds.step()
        impulse += float(worlds["ground_force"].sum()) * DT
    mean = (impulse - (momentum() - start)) / (steps * DT)
    np.testing.assert_allclose(mean, MASS * GRAVITY, rtol=1e-3)


def test_small_swings_of_a_leg_have_the_period_of_a_pendulum() -> None:
    """Trunk held: 2 pi sqrt(L / g) with the leg stretched by the weight of the foot, to 0.1%."""
    parameters = passive(trunk_pinned=True, swing_damping=140.0)
    length = LENGTH + FOOT * GRAVITY / STIFFNESS
    trunk, feet = run(parameters, pose(y=3.0, hip_angle=(0.02, -0.02), leg_length=(length, length)), 10_000)
    swing = feet[:, 0, 0] - trunk[:, 0]
    down = np.flatnonzero((swing[:-1] > 0) & (swing[1:] <= 0))
    crossings = down + swing[down] / (swing[down] - swing[down + 1])
    period = np.diff(crossings).mean() * DT
    assert len(crossings) > 9
    np.testing.assert_allclose(period, 2 * math.pi * math.sqrt(length / GRAVITY), rtol=1e-3)


def test_flight_conserves_momentum_under_hip_torques() -> None:
    """Hip torques are equal and opposite: in flight they change neither linear nor angular momentum."""
    parameters = passive(gravity=0.0, trunk_locked=False, trunk_moment_limit=math.inf, swing_damping=140.0)
    worlds = Worlds(parameters)
    worlds.batch.place(0, pose(y=5.0, hip_angle=(0.3, -0.3), pitch_rate=0.5))

    def momenta() -> np.ndarray:
        trunk, feet = worlds.trunk(), worlds.feet()
        mass = np.array([TRUNK, FOOT, FOOT])[:, None]
        bodies = np.vstack([trunk, feet])
        r = bodies[:, :2] - (mass * bodies[:, :2]).sum(0) / MASS
        spin = (mass[:, 0] * (r[:, 0] * bodies[:, 4] - r[:, 1] * bodies[:, 3])).sum() + 3.0 * trunk[5]
        return np.array([*(mass * bodies[:, 3:5]).sum(0), spin])

    start, pitch_rate = momenta(), worlds.trunk()[5]
    action = np.array([[1.0, 0.6]], np.float32)
    for _ in range(24):
        worlds.step(action)
    np.testing.assert_allclose(momenta(), start, atol=2e-3)
    assert worlds.trunk()[5] < pitch_rate - 1.0  # the legs swing forward, the trunk turns against them


def test_frictionless_ground_keeps_the_horizontal_momentum() -> None:
    worlds = Worlds(core_parameters(friction=0.0, fall_height=0.0, trunk_moment_limit=math.inf))
    worlds.batch.place(0, pose(y=0.898, vx=2.0, hip_angle=(0.3, -0.2)))
    mass = np.array([TRUNK, FOOT, FOOT])
    touched = False
    for _ in range(10):
        worlds.step(np.array([[0.5, -1.0]], np.float32))
        momentum = mass @ [worlds.trunk()[3], *worlds.feet()[:, 3]]
        np.testing.assert_allclose(momentum, MASS * 2.0, rtol=1e-5)
        touched |= bool(worlds["ground_force"].max() > 100.0)
    assert touched


def test_torque_lag_is_first_order() -> None:
    """Step response 1 - exp(-t / 0.02 s) of the hip motors, without a trunk-moment limit."""
    worlds = Worlds(passive(trunk_moment_limit=math.inf, gravity=0.0))
    worlds.batch.place(0, pose(y=5.0))
    for n in range(1, 30):
        worlds.step(np.array([[1.0, -0.5]], np.float32))
        expected = 60.0 * (1.0 - math.exp(-n * DT / 0.02)) * np.array([1.0, -0.5])
        np.testing.assert_allclose(worlds["hip_torque"][0], expected, rtol=1e-5)


@pytest.mark.parametrize("limit", [5.0, 25.0])
def test_trunk_moment_limit_holds(limit: float) -> None:
    """|left + right| never exceeds the limit, half of the excess is taken from each hip."""
    worlds = Worlds(passive(trunk_moment_limit=limit, torque_lag=0.0), num_worlds=16)
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 16, 2)).astype(np.float32)
    for action in actions:
        worlds.step(action)
        torque = worlds["hip_torque"].astype(np.float64)
        command = 60.0 * action.astype(np.float64)
        assert np.abs(torque.sum(1)).max() <= limit + 1e-4
        np.testing.assert_allclose(torque[:, 0] - torque[:, 1], command[:, 0] - command[:, 1], atol=1e-4)
        free = np.abs(command.sum(1)) <= limit
        np.testing.assert_allclose(torque[free], command[free], atol=1e-4)


def test_hip_stops_and_leg_stops_hold() -> None:
    """Random torques of 60 N m in flight: no hip beyond its stop by 0.1 rad, no leg beyond its limits by 5 mm."""
    worlds = Worlds(core_parameters(gravity=0.0, trunk_moment_limit=math.inf, fall_height=0.0), num_worlds=8)
    for world in range(8):
        worlds.batch.place(world, pose(y=5.0))
    rng = np.random.default_rng(1)
    reached = 0.0
    for _ in range(40):
        worlds.step(np.sign(rng.normal(size=(8, 2))).astype(np.float32))
        strain, angle = worlds["observation"][:, 6:8], worlds["observation"][:, 10:12]
        assert strain.max() * LENGTH < 0.05 * LENGTH + 5e-3
        assert strain.min() * LENGTH > -0.5 * LENGTH - 5e-3
        assert np.abs(angle).max() < 1.4
        reached = max(reached, float(np.abs(angle).max()))
    assert reached > 1.3


def test_unloaded_leg_retracts_and_extends_again() -> None:
    """Beside a loaded leg, a leg swinging forward is 15% shorter in early swing, full past half the touchdown angle."""
    parameters = core_parameters(trunk_pinned=True, gravity=0.0, fall_height=0.0, control_frequency=480.0, substeps=1)
    start = pose(
        y=LENGTH + RADIUS - 0.05, hip_angle=(-0.5, 0.0), hip_rate=(3.0, 0.0), leg_length=(LENGTH, LENGTH - 0.05)
    )
    trunk, feet = run(parameters, start, 200)
    leg = feet[:, 0, :2] - trunk[:, :2]
    length, angle = np.hypot(leg[:, 0], leg[:, 1]), np.arctan2(leg[:, 0], -leg[:, 1])
    early = (angle < 0.25) & (np.arange(201) > 0.1 * SUBSTEPS_PER_SECOND)
    assert early.any()
    np.testing.assert_allclose(length[early], 0.85 * LENGTH, atol=0.01 * LENGTH)
    late = np.flatnonzero(angle > 0.25)[0] + int(0.12 * SUBSTEPS_PER_SECOND)
    np.testing.assert_allclose(length[late:], LENGTH, atol=0.01 * LENGTH)


def test_no_leg_retracts_in_flight() -> None:
    parameters = core_parameters(gravity=0.0, control_frequency=480.0, substeps=1)
    trunk, feet = run(parameters, pose(y=3.0, hip_angle=(-0.5, 0.3)), 100)
    length = np.hypot(*(feet[:, :, :2] - trunk[:, None, :2]).transpose(2, 0, 1))
    np.testing.assert_allclose(length, LENGTH, atol=1e-4)


def test_free_trunk_falls_beyond_its_pitch_limit_and_a_locked_one_stays() -> None:
    for locked in (False, True):
        worlds = Worlds(core_parameters(trunk_locked=locked, trunk_pitch_limit=0.3, gravity=0.0, fall_height=0.0))
        worlds.batch.place(0, pose(y=3.0, hip_angle=(0.3, -0.3)))
        for _ in range(60):
            worlds.step(np.ones((1, 2), np.float32))
            if worlds["terminated"][0]:
                break
        pitch = float(worlds["final_observation"][0, 4])
        assert bool(worlds["terminated"][0]) == (not locked)
        assert pitch > 0.3 if not locked else pitch == 0.0
