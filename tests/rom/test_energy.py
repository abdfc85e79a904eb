"""What hip motors and retraction do: cases worked by hand, and the balance of energy of a gait."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.features import POWERS
from romgrl.rom import _core
from tests.helpers.rom_worlds import GRAVITY, SHORTENING, Worlds, core_parameters, passive, pose

pytestmark = pytest.mark.usefixtures("engine")

LENGTH, RADIUS, FOOT, MASS, STIFFNESS = 0.865, 0.072, 0.9, 71.8, 24000.0
DT = 1.0 / 480.0
STANCE_DAMPING, SWING_DAMPING = 30.0, 140.0


def told(worlds: Worlds) -> dict[str, float]:
    """All four powers of world 0, W."""
    return {name: float(worlds[name][0]) for name in POWERS}


@pytest.mark.parametrize(("share", "rate"), [(0.5, 3.0), (-0.5, 3.0), (0.5, -3.0), (-1.0, -2.0)])
def test_a_known_torque_at_a_known_rate(share: float, rate: float) -> None:
    """A foot m on a leg L, alone: the rate grows by tau dt / (m L^2), so power is tau (w + tau dt / (2 m L^2))."""
    motors = {"torque_lag": 0.0, "trunk_moment_limit": np.inf}
    worlds = Worlds(passive(trunk_pinned=True, gravity=0.0, **motors))
    worlds.batch.place(0, pose(y=3.0, hip_angle=(0.3, -0.3), hip_rate=(rate, 0.0)))
    worlds.step(np.array([[share, 0.0]], np.float32))
    torque = 60.0 * share
    power = torque * (rate + torque * DT / (2 * FOOT * LENGTH**2))
    expected = {"power": abs(power), "positive_power": max(power, 0.0)}
    assert told(worlds) == pytest.approx(expected | dict.fromkeys(POWERS[2:], 0.0), rel=1e-4)


def test_legs_that_work_against_each_other_do_not_cancel() -> None:
    """Both hips turn at 2 rad/s; one drives with 30 N m, the other one brakes with as much."""
    worlds = Worlds(passive(trunk_pinned=True, gravity=0.0, torque_lag=0.0, trunk_moment_limit=np.inf))
    worlds.batch.place(0, pose(y=3.0, hip_angle=(0.3, -0.3), hip_rate=(2.0, 2.0)))
    worlds.step(np.array([[0.5, -0.5]], np.float32))
    more = 30.0 * DT / (2 * FOOT * LENGTH**2)
    assert told(worlds)["power"] == pytest.approx(30 * (2 + more) + 30 * (2 - more), rel=1e-4)
    assert told(worlds)["positive_power"] == pytest.approx(30 * (2 + more), rel=1e-4)


def test_the_rate_of_a_hip_is_relative_to_the_trunk() -> None:
    """The trunk alone turns: its pitch rate is the hip's, and the torque drives its inertia of 3 kg m^2, too."""
    free = {"trunk_locked": False, "trunk_moment_limit": np.inf, "torque_lag": 0.0}
    worlds = Worlds(passive(gravity=0.0, **free))
    worlds.batch.place(0, pose(y=3.0, pitch_rate=1.5, hip_rate=(1.5, 1.5)))
    before = worlds.trunk()[5], worlds.feet()[:, 3]
    worlds.step(np.array([[1.0, 0.0]], np.float32))
    after = worlds.trunk()[5], worlds.feet()[:, 3]
    rates = [feet[0] / LENGTH - angle for angle, feet in (before, after)]
    assert rates[0] == pytest.approx(1.5, rel=1e-5)
    trunk = 60.0 / (MASS - 2 * FOOT) / LENGTH * DT / LENGTH  # by which the hip moves back
    assert rates[1] - rates[0] == pytest.approx(60.0 * DT * (1 / (FOOT * LENGTH**2) + 1 / 3.0), rel=1e-4)
    assert told(worlds)["power"] == pytest.approx(60.0 * (rates[0] + rates[1] + trunk) / 2, rel=1e-4)


def standing_and_swinging(**values: Any) -> Worlds:
    """The trunk held; the right leg presses on the ground, the left one is straight behind and in the air."""
    worlds = Worlds(core_parameters(trunk_pinned=True, gravity=0.0, fall_height=0.0, **values))
    start = pose(y=LENGTH + RADIUS - 0.05, hip_angle=(-0.5, 0.0), leg_length=(LENGTH, LENGTH - 0.05))
    worlds.batch.place(0, start)
    return worlds


def test_retraction_winds_the_spring() -> None:
    """From rest the spring of the swing leg takes k d^2 / 2, d = 0.15 L dt / 0.08 s; the hips do nothing."""
    worlds = standing_and_swinging(control_frequency=480.0, substeps=1)
    worlds.step()
    power = 0.5 * STIFFNESS * (0.15 * LENGTH * DT / 0.08) ** 2 / DT
    assert told(worlds) == pytest.approx(dict.fromkeys(POWERS, power), rel=1e-3)


def test_a_step_of_many_substeps_is_their_mean() -> None:
    many = standing_and_swinging(control_frequency=30.0, substeps=16)
    single = standing_and_swinging(control_frequency=480.0, substeps=1)
    action = np.array([[0.8, -0.4]], np.float32)
    many.step(action)
    powers = []
    for _ in range(16):
        single.step(action)
        powers.append(list(told(single).values()))
    np.testing.assert_allclose(list(told(many).values()), np.mean(powers, axis=0), rtol=1e-4)
    assert min(told(many).values()) > 1.0


def test_a_diverged_step_and_a_reset_have_no_power() -> None:
    worlds = Worlds(passive(hip_torque=1e5, foot_mass=1e-4, torque_lag=0.0, stiffness=1e-3))
    worlds.step(np.ones((1, 2), np.float32))
    assert worlds["diverged"][0]
    assert told(worlds) == dict.fromkeys(POWERS, 0.0)


class Energies:
    """The energy of world 0 and what dampers and ground take from it, from the states at the ends of a substep."""

    def __init__(self, parameters: _core.Parameters) -> None:
        self.worlds = Worlds(parameters)
        self.dt = 1.0 / parameters.control_frequency
        self.radius = parameters.roll_over_radius or RADIUS

    def bodies(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Trunk (6,) and feet (2, 6)."""
        return self.worlds.trunk(), self.worlds.feet()

    def energy(self) -> float:
        """Kinetic, potential and of the springs, J."""
        trunk, feet = self.bodies()
        shortening = self.worlds.batch.save()[0, SHORTENING]
        length = np.hypot(*(feet[:, :2] - trunk[:2]).T)
        mass = np.array([MASS - 2 * FOOT, FOOT, FOOT])
        bodies = np.vstack((trunk, feet))
        kinetic = 0.5 * mass @ (bodies[:, 3:5] ** 2).sum(axis=1)
        return float(
            kinetic + GRAVITY * mass @ bodies[:, 1] + 0.5 * STIFFNESS * ((LENGTH - shortening - length) ** 2).sum()
        )

    def step(self, action: NDArray[np.float32]) -> tuple[float, float]:
        """Work of the actuators, and of dampers and ground, in one substep, J."""
        (trunk, feet), dt = self.bodies(), self.dt
        away = feet[:, :2] - trunk[:2]
        length = np.hypot(*away.T)
        along = away / length[:, None]
        rate = (along * (feet[:, 3:5] - trunk[3:5])).sum(axis=1)
        self.worlds.step(action)
        new_trunk, new_feet = self.bodies()
        rest = LENGTH - self.worlds.batch.save()[0, SHORTENING]
        loaded = (feet[:, 1] <= self.radius + (self.radius - RADIUS) * along[:, 1]) & (length < rest)
        damping = np.where(loaded, STANCE_DAMPING, SWING_DAMPING)
        new_rate = (along * (new_feet[:, 3:5] - new_trunk[3:5])).sum(axis=1)
        damped = float((-damping * rate * 0.5 * (rate + new_rate)).sum() * dt)
        across = np.stack((-along[:, 1], along[:, 0]), axis=1)
        force = (STIFFNESS * (rest - length) - damping * rate)[:, None] * along
        force += (self.worlds["hip_torque"][0] / length)[:, None] * across - [0.0, FOOT * GRAVITY]
        impulse = FOOT * (new_feet[:, 3:5] - feet[:, 3:5]) - force * dt  # of the ground
        ground = float((impulse * 0.5 * (feet[:, 3:5] + new_feet[:, 3:5])).sum())
        pull = (MASS - 2 * FOOT) * (new_trunk[3:5] - trunk[3:5] + [0.0, GRAVITY * dt]) + force.sum(axis=0) * dt
        pull += [0.0, 2 * FOOT * GRAVITY * dt]  # `force` has the weights of the feet
        ground += float(pull @ (0.5 * (trunk[3:5] + new_trunk[3:5])))  # what the ground gives the trunk across a leg
        powers = told(self.worlds)
        return (2 * powers["positive_power"] - powers["power"]) * dt, damped + ground


@pytest.mark.parametrize("rolling", [0.0, 0.3])
def test_energy_is_balanced(rolling: float) -> None:
    """Both actuators and impacts, short of the hip stops, at 4,800 substeps a second, where Euler's rule errs little.

    What the actuators put in less what dampers and ground take is what bodies and springs have more.
    """
    values = {"control_frequency": 4800.0, "substeps": 1, "fall_height": 0.0, "episode_steps": 10**6}
    parameters = core_parameters(roll_over_radius=rolling, **values)
    energies = Energies(parameters)
    worlds = energies.worlds
    worlds.batch.seed(1)
    worlds.batch.reset()
    start, put_in, taken, retraction, contacts, angle = energies.energy(), 0.0, 0.0, 0.0, 0, 0.0
    for step in range(1200):
        swing = np.sin(2 * np.pi * 1.5 * step / 4800.0)
        work, lost = energies.step(np.array([[swing, -swing]], np.float32))
        put_in, taken = put_in + work, taken + lost
        retraction += float(worlds["positive_retraction_power"][0]) / 4800.0
        contacts += int(worlds["contact"].any())
        angle = max(angle, float(np.abs(worlds["observation"][0, 10:12]).max()))
    gained = energies.energy() - start
    print(f"gained {gained:.2f} J, put in {put_in:.2f} J, taken {taken:.2f} J, retraction {retraction:.2f} J")
    assert angle < 1.3
    assert retraction > 5.0
    assert contacts > 100
    assert put_in - retraction > 5.0
    assert taken < -10.0
    assert gained == pytest.approx(put_in + taken, abs=0.01 * (put_in - taken))
