"""Legs whose rest length a motor moves: the equations, the limits, the balance of energy, both engines alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from romgrl.rom import _core
from romgrl.rom.observation import MOTOR_ACTION_NAMES, MOTOR_OBSERVATION_NAMES, mirror
from tests.helpers.rom_worlds import (
    EXTENSION,
    EXTENSION_RATE,
    GRAVITY,
    MOTOR,
    WALKER,
    Worlds,
    core_parameters,
    passive,
    pose,
)

LENGTH, RADIUS, STIFFNESS, FOOT, MASS = 0.865, 0.072, 24000.0, 0.9, 71.8
TRUNK = MASS - 2 * FOOT
FORCE, SPEED, POWER, ECCENTRIC = 1436.0, 3.0, 1077.0, 1.5
each_engine = pytest.mark.usefixtures("engine")
Array = NDArray[Any]


def drives(left: float, right: float, hips: float = 0.0) -> NDArray[np.float32]:
    """Actions of one world."""
    return np.array([[hips, -hips, left, right]], np.float32)


def held(*, length: float = LENGTH, **values: Any) -> Worlds:
    """The trunk held in the air where nothing pulls, legs vertical, and motors without lag and with a long stroke."""
    wide = {"shortest_rest": 0.6, "longest_rest": 1.4, "extension_limit": 1.5, "motor_lag": 0.0}
    wide |= {"trunk_pinned": True, "gravity": 0.0}
    worlds = Worlds(passive(**MOTOR | wide | values))
    worlds.batch.place(0, pose(y=length + RADIUS, leg_length=(length, length)))
    return worlds


@each_engine
def test_the_force_at_rest() -> None:
    """Pressed on the ground by a held trunk, the leg pushes with the motor's force at a standstill, times the drive."""
    worlds = held(swing_damping=140.0, stance_damping=140.0)
    for drive in (1.0, 0.5):
        for _ in range(960):
            worlds.step(drives(drive, drive))
        load = worlds["observation"][0, 14:16] * MASS * 1.0  # per body weight where gravity counts as 1
        np.testing.assert_allclose(load, drive * FORCE, rtol=1e-3)


@each_engine
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_speed_without_a_load(side: float) -> None:
    """A spring too soft to be felt: the carriage comes to its no-load speed, and not above."""
    worlds = held(stiffness=1e-3, shortest_rest=0.06, compression_limit=0.05, longest_rest=1.5, extension_limit=2.0)
    fastest = 0.0
    for _ in range(40):
        worlds.step(drives(side, side))
        fastest = max(fastest, float(np.abs(worlds.batch.save()[0, EXTENSION_RATE]).max()))
    assert fastest == pytest.approx(SPEED, rel=0.02)
    assert fastest <= SPEED * (1 + 1e-6)


@each_engine
def test_no_more_power_than_allowed() -> None:
    """Under any drive and load the work of a substep is at most the largest power's; an overpowered motor brakes."""
    limit = 100.0
    worlds = Worlds(core_parameters(motor_power=limit, control_frequency=480.0, substeps=1, **MOTOR), 64)
    rng = np.random.default_rng(0)
    largest, smallest = 0.0, 0.0
    for _ in range(400):
        worlds.step(rng.uniform(-1, 1, (64, 4)).astype(np.float32))
        positive, both = worlds["positive_leg_motor_power"], worlds["leg_motor_power"]
        largest = max(largest, float(positive.max()))
        smallest = min(smallest, float((positive - both).min()))
    assert 1.5 * limit < largest <= 2 * limit * (1 + 1e-5)  # of two legs
    assert smallest < -2 * limit


@each_engine
def test_an_overpowered_motor_holds_more_but_not_without_end() -> None:
    """A carriage that is pushed back at 2 m/s: 1.5 times the force at rest, by what it takes from its speed."""
    worlds = held(stiffness=1e-3, motor_mass=100.0)
    worlds.batch.place(0, pose(y=LENGTH + RADIUS, extension_rate=(-2.0, 2.0)))
    worlds.step(drives(1.0, 1.0))
    rates = worlds.batch.save()[0, EXTENSION_RATE]
    assert (rates[0] + 2.0) * 100.0 * 480.0 == pytest.approx(ECCENTRIC * FORCE, rel=1e-5)
    assert (rates[1] - 2.0) * 100.0 * 480.0 == pytest.approx((1 - 2.0 / SPEED) * FORCE, rel=1e-5)


@each_engine
def test_a_carriage_stays_within_its_stroke() -> None:
    worlds = Worlds(core_parameters(**MOTOR), 64)
    rng = np.random.default_rng(0)
    lowest, highest = 0.0, 0.0
    for _ in range(200):
        worlds.step(np.sign(rng.uniform(-1, 1, (64, 4))).astype(np.float32))
        extension = worlds.batch.save()[:, EXTENSION]
        lowest, highest = min(lowest, float(extension.min())), max(highest, float(extension.max()))
    assert lowest == pytest.approx(-0.05 * LENGTH, rel=1e-6)
    assert highest == pytest.approx(0.05 * LENGTH, rel=1e-6)


@each_engine
def test_a_push_lengthens_the_leg_over_a_stance() -> None:
    """A hop whose motor pushes in the second half of the stance rises higher than one that does not."""
    heights = []
    for drive in (0.0, 1.0):
        worlds = Worlds(passive(**MOTOR, motor_lag=0.0, trunk_moment_limit=0.0))
        worlds.batch.place(0, pose(y=LENGTH + RADIUS - 1e-6, vy=-1.0))
        highest = 0.0
        for _ in range(240):
            up = worlds.trunk()[4] > 0
            worlds.step(drives(drive, drive) if up else drives(0.0, 0.0))
            highest = max(highest, float(worlds.trunk()[1]))
        heights.append(highest)
    assert heights[1] > heights[0] + 0.05


def energy(worlds: Worlds) -> float:
    """Kinetic, potential and of the springs, carriages included, J."""
    state, trunk, feet = worlds.batch.save()[0], worlds.trunk(), worlds.feet()
    length = np.hypot(*(feet[:, :2] - trunk[:2]).T)
    mass = np.array([TRUNK, FOOT, FOOT])
    bodies = np.vstack((trunk, feet))
    kinetic = 0.5 * mass @ (bodies[:, 3:5] ** 2).sum(axis=1) + 0.5 * 2.5 * (state[EXTENSION_RATE] ** 2).sum()
    springs = 0.5 * STIFFNESS * ((LENGTH + state[EXTENSION] - length) ** 2).sum()
    return float(kinetic + GRAVITY * mass @ bodies[:, 1] + springs)


@each_engine
def test_the_energy_of_motors_and_springs_is_balanced() -> None:
    """In flight without dampers, within the strokes: what motors and hips put in, bodies and springs have more."""
    wide = {"shortest_rest": 0.6, "longest_rest": 1.4, "compression_limit": 0.3, "extension_limit": 1.5}
    worlds = Worlds(passive(control_frequency=9600.0, trunk_moment_limit=np.inf, **MOTOR | wide))
    worlds.batch.place(0, pose(y=20.0, hip_angle=(0.2, -0.2)))
    start, put_in, moved = energy(worlds), 0.0, 0.0
    for step in range(4800):
        swing = np.cos(2 * np.pi * 3.0 * step / 9600.0)  # from rest, so that nothing drifts to a stop
        worlds.step(drives(0.15 * swing, -0.1 * swing, 0.2 * swing))
        power = 2 * worlds["positive_power"][0] - worlds["power"][0]
        put_in, moved = put_in + float(power) / 9600.0, moved + float(worlds["power"][0]) / 9600.0
    assert np.abs(worlds.batch.save()[0, EXTENSION]).max() < 0.34
    assert moved > 20.0
    assert energy(worlds) - start == pytest.approx(put_in, abs=0.01 * moved)


@each_engine
def test_dampers_and_stops_only_take() -> None:
    """A fall on passive legs: no energy comes from dampers that move with the rest length, stops, or ground."""
    worlds = Worlds(passive(swing_damping=140.0, stance_damping=140.0, control_frequency=4800.0, **MOTOR))
    worlds.batch.place(0, pose(y=LENGTH + RADIUS + 0.05, hip_angle=(0.2, -0.2), extension_rate=(0.5, -0.5)))
    energies = [energy(worlds)]
    for _ in range(2400):
        worlds.step()
        energies.append(energy(worlds))
    assert energies[-1] < energies[0] - 10.0
    assert np.diff(energies).max() < 0.3  # J; a leapfrog's own ripple


def test_the_engines_are_alike() -> None:
    """From the same state with the same action, substep by substep: to 1e-4 in SI units, but where rounding decides."""
    values = dict(MOTOR, control_frequency=480.0, substeps=1, episode_steps=10**6, fall_height=0.0)
    box2d, native = (Worlds(core_parameters(engine_is_native=own, **values), 200) for own in (False, True))
    rng, errors, powers = np.random.default_rng(7), [], []
    for world in range(200):
        angle, length = rng.uniform(-0.8, 0.8, 2), rng.uniform(0.75, 0.9, 2)
        height = float((length * np.cos(angle)).max() + RADIUS + rng.uniform(0.0, 0.05))
        carriages = {"extension": rng.uniform(-0.04, 0.04, 2), "extension_rate": rng.uniform(-1, 1, 2)}
        box2d.batch.place(world, pose(y=height, vx=rng.uniform(0, 4), hip_angle=angle, leg_length=length, **carriages))
    for _ in range(150):
        native.batch.restore(box2d.batch.save())
        action = rng.uniform(-1, 1, (200, 4)).astype(np.float32)
        for worlds in (box2d, native):
            worlds.step(action)
        going = ~(box2d["diverged"] | native["diverged"])
        errors.append(np.abs(native.batch.save() - box2d.batch.save())[going, WALKER].max(axis=1))
        powers.append(
            np.abs(native["leg_motor_power"] - box2d["leg_motor_power"])[going] / (10 + box2d["leg_motor_power"][going])
        )
    assert np.quantile(np.concatenate(errors), 0.9995) < 1e-4
    assert np.quantile(np.concatenate(powers), 0.9995) < 1e-3
    assert np.abs(native.batch.save()[:, EXTENSION]).max() > 0.04


@each_engine
def test_a_mirrored_world_stays_the_mirror_image() -> None:
    observation, action = mirror(MOTOR_OBSERVATION_NAMES), mirror(MOTOR_ACTION_NAMES)
    worlds, others = (Worlds(core_parameters(fall_height=0.0, **MOTOR)) for _ in range(2))
    worlds.batch.place(0, pose(y=0.9, vx=3.0, hip_angle=(0.3, -0.3), extension=(0.01, -0.02)))
    others.batch.place(0, pose(y=0.9, vx=3.0, hip_angle=(-0.3, 0.3), extension=(-0.02, 0.01)))
    rng = np.random.default_rng(3)
    for _ in range(30):
        chosen = rng.uniform(-1, 1, (1, 4)).astype(np.float32)
        worlds.step(chosen)
        others.step(np.ascontiguousarray(action.image(chosen)))
        np.testing.assert_array_equal(observation.image(worlds["final_observation"]), others["final_observation"])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"observation_is_paper": True}, "observation: the paper's has no leg motor"),
        ({"motor_mass": 0.5}, "motor_mass 0.5 kg cannot be integrated"),
        ({"motor_eccentric": 0.9}, "motor_eccentric = 0.9 is not between 1 and 10"),
        ({"shortest_rest": 0.4}, "shortest_rest must exceed compression_limit"),
        ({"longest_rest": 1.15}, "longest_rest must be below extension_limit"),
        ({"speed_low": 3.0, "speed_high": 2.0}, "speed_high = 2 is not between 3 and 10"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        _core.Batch(core_parameters(**MOTOR | values), 1, 1)


@each_engine
def test_a_bounce_with_a_push_is_the_differential_equations() -> None:
    """Body on spring and carriage, foot on the ground, full drive from touchdown on: heights to 2 mm, rates to 1 %."""
    frequency = 3840.0
    values = {"control_frequency": frequency, "motor_lag": 0.0, "shortest_rest": 0.6, "longest_rest": 1.4}
    worlds = Worlds(passive(trunk_moment_limit=0.0, **MOTOR | values | {"extension_limit": 1.5}))
    worlds.batch.place(0, pose(y=LENGTH + RADIUS - 1e-6, vy=-1.0))

    def rates(_: float, state: Array) -> list[float]:
        """Height of the body, its rate, extension of each leg, its rate."""
        height, up, extension, rate = state
        push = STIFFNESS * (LENGTH + extension - height)
        motor = FORCE * (max(1 - rate / SPEED, 0.0) if rate >= 0 else min(1 - 0.5 * rate, ECCENTRIC))
        motor = min(motor, POWER / rate) if rate > 0 else motor
        return [up, 2 * push / TRUNK - GRAVITY, rate, (motor - push) / 2.5]

    options = {"rtol": 1e-9, "atol": 1e-11, "max_step": 1e-4}
    exact = solve_ivp(rates, (0.0, 0.2), [LENGTH - 1e-6, -1.0, 0.0, 0.0], **options).y[:, -1]
    for _ in range(int(0.2 * frequency)):
        worlds.step(drives(1.0, 1.0))
        assert worlds["contact"].all()
    state = worlds.batch.save()[0]
    assert float(worlds.trunk()[1]) - RADIUS == pytest.approx(exact[0], abs=2e-3)
    assert float(worlds.trunk()[4]) == pytest.approx(exact[1], rel=5e-3)
    assert state[EXTENSION] == pytest.approx([exact[2]] * 2, abs=2e-3)
    assert state[EXTENSION_RATE] == pytest.approx([exact[3]] * 2, rel=1e-2)
