"""One stance of the spring-mass runner against the differential equations, solved by scipy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.helpers.rom_worlds import GRAVITY, MOTOR, passive, pose, run

pytestmark = pytest.mark.usefixtures("engine")

LENGTH, RADIUS, STIFFNESS, FOOT = 0.865, 0.072, 24000.0, 0.9
TRUNK = 71.8 - 2 * FOOT
HEAVY = {
    "motor_mass": 1e8,
    "shortest_rest": 0.6,
    "longest_rest": 1.4,
    "extension_limit": 1.5,
}  # nothing moves its carriage
MASSES = np.array([TRUNK, FOOT, FOOT])
Array = NDArray[np.float64]


@dataclass
class Bounce:
    duration: float  # from touchdown until the stance leg is at rest length again, s
    apex: float  # greatest trunk height after it, m
    energy: float  # mechanical energy at the apex, J


def leg_force(hip: Array, foot: Array, damping: float, longer: float = 0.0, rate: float = 0.0) -> Array:
    """Force on the foot of a leg whose rest length is `longer` by so much, m, and grows at a rate, m/s.

    Bodies are x, y, vx, vy.
    """
    d = foot[:2] - hip[:2]
    length = np.hypot(*d)
    u = d / length
    return (STIFFNESS * (LENGTH + longer - length) - damping * (u @ (foot[2:] - hip[2:]) - rate)) * u


def rates(time: float, state: Array, *, grounded: bool, stance: float, swing: float, lengthening: float) -> Array:
    """Trunk, left and right foot, each x, y, vx, vy; a grounded left foot does not move, and its leg lengthens."""
    bodies = state.reshape(3, 4)
    left = leg_force(bodies[0], bodies[1], stance if grounded else swing, lengthening * time, lengthening)
    right = leg_force(bodies[0], bodies[2], swing)
    force = np.array([-left - right, left, right])
    acceleration = force / MASSES[:, None] - [0.0, GRAVITY]
    if grounded:
        acceleration[1] = 0.0
    return np.hstack([bodies[:, 2:], acceleration]).ravel()


def energy(bodies: Array, longer: float) -> float:
    """Kinetic, gravitational and elastic energy of (3, 4) bodies; heights from y = 0; the left leg may be longer."""
    kinetic = 0.5 * MASSES @ (bodies[:, 2:] ** 2).sum(1)
    lengths = np.hypot(*(bodies[1:, :2] - bodies[0, :2]).T)
    springs = 0.5 * STIFFNESS * ((lengths - LENGTH - [longer, 0.0]) ** 2).sum()
    return float(kinetic + GRAVITY * MASSES @ bodies[:, 1] + springs)


def exact(start: Array, *, stance: float, swing: float, lengthening: float, horizon: float) -> Bounce:
    """The left foot stands until the leg is at rest length, then flies."""

    def at_rest(time: float, state: Array) -> float:
        bodies = state.reshape(3, 4)
        return float(np.hypot(*(bodies[1, :2] - bodies[0, :2])) - LENGTH - lengthening * time)

    at_rest.terminal, at_rest.direction = True, 1.0
    leg = {"stance": stance, "swing": swing, "lengthening": lengthening}
    options = {"rtol": 1e-9, "atol": 1e-10, "max_step": 1e-3}
    down = solve_ivp(lambda t, s: rates(t, s, grounded=True, **leg), (0, 1), start.ravel(), events=at_rest, **options)
    up = solve_ivp(lambda t, s: rates(t, s, grounded=False, **leg), (down.t[-1], horizon), down.y[:, -1], **options)
    apex = int(up.y[1].argmax())
    longer = lengthening * float(up.t[apex])
    return Bounce(float(down.t[-1]), float(up.y[1, apex]), energy(up.y[:, apex].reshape(3, 4), longer))


def simulated(
    frequency: float, *, stance: float, swing: float, vx: float, vy: float, angle: float, lengthening: float = 0.0
) -> tuple[Bounce, Array]:
    """The same bounce in Box2D, and the state at touchdown for the differential equations.

    Box2D's velocities lag half a substep behind its positions (it is a leapfrog scheme), so velocities are centred.
    """
    leg = MOTOR | HEAVY if lengthening else {}
    parameters = passive(
        control_frequency=frequency,
        stance_damping=stance,
        swing_damping=swing,
        friction=50.0,
        trunk_moment_limit=0.0,
        **leg,
    )
    height = LENGTH * np.cos(angle) + RADIUS - 1e-6
    placed = pose(y=height, vx=vx, vy=vy, hip_angle=(angle, -1.2), leg_length=(LENGTH, LENGTH))
    placed.extension_rate = (lengthening, 0.0)
    trunk, feet = run(parameters, placed, int(0.5 * frequency))
    bodies = np.concatenate([trunk[:, None], feet], axis=1)[:, :, [0, 1, 3, 4]]
    bodies[:-1, :, 2:] = 0.5 * (bodies[:-1, :, 2:] + bodies[1:, :, 2:])
    bodies[0, 1, 2:] = 0.0  # the foot stops at touchdown: its kinetic energy is lost
    length = np.hypot(*(bodies[:, 1, :2] - bodies[:, 0, :2]).T)
    excess = length - LENGTH - lengthening * np.arange(len(length)) / frequency
    n = int(np.flatnonzero((excess[2:-1] < 0) & (excess[3:] >= 0))[0]) + 2
    duration = (n - excess[n] / (excess[n + 1] - excess[n])) / frequency
    apex = n + int(bodies[n:-1, 0, 1].argmax())
    return Bounce(duration, float(bodies[apex, 0, 1]), energy(bodies[apex], lengthening * apex / frequency)), bodies[0]


@pytest.mark.parametrize("frequency", [480.0, 960.0])
@pytest.mark.parametrize(("stance", "swing"), [(0.0, 140.0), (30.0, 140.0)])
@pytest.mark.parametrize(("vx", "vy", "angle"), [(0.0, -1.0, 0.0), (3.0, -0.8, 0.3), (4.0, -1.0, 0.4)])
def test_stance_follows_the_differential_equations(
    frequency: float, stance: float, swing: float, vx: float, vy: float, angle: float
) -> None:
    """Duration to 0.1%, apex to 2 mm, energy to 0.2%, at the default substep and at half of it."""
    found, start = simulated(frequency, stance=stance, swing=swing, vx=vx, vy=vy, angle=angle)
    steps = int(0.5 * frequency)
    expected = exact(start, stance=stance, swing=swing, lengthening=0.0, horizon=(steps - 1) / frequency)
    assert found.duration == pytest.approx(expected.duration, rel=1e-3)
    assert found.apex == pytest.approx(expected.apex, abs=2e-3)
    assert found.energy == pytest.approx(expected.energy, rel=2e-3)


@pytest.mark.parametrize("lengthening", [0.3, -0.2])
@pytest.mark.parametrize(("vx", "vy", "angle"), [(0.0, -1.0, 0.0), (3.0, -0.8, 0.3)])
def test_a_rest_length_that_moves_follows_them_too(lengthening: float, vx: float, vy: float, angle: float) -> None:
    """Prescribed by a carriage too heavy to be held up: duration to 0.1%, apex to 2 mm, energy to 0.2%."""
    frequency, damping = 960.0, {"stance": 30.0, "swing": 140.0}
    found, start = simulated(frequency, **damping, vx=vx, vy=vy, angle=angle, lengthening=lengthening)
    horizon = (int(0.5 * frequency) - 1) / frequency
    expected = exact(start, **damping, lengthening=lengthening, horizon=horizon)
    assert found.duration == pytest.approx(expected.duration, rel=1e-3)
    assert found.apex == pytest.approx(expected.apex, abs=2e-3)
    assert found.energy == pytest.approx(expected.energy, rel=2e-3)
