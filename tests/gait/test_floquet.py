"""Multipliers of systems that have them in closed form, or as an integral along the orbit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from romgrl.gait.floquet import Array, Map, decay, jacobians, multipliers

Flow = Callable[[Array], Array]  # states (B, 2) to their rates


def fixed_point(
    return_map: Map, start: Array, steps: Array, *, iterations: int = 50, tolerance: float = 1e-10
) -> Array:
    """x* (n,) near `start` by Newton's method, x <- x - (J - 1)^-1 (P(x) - x); ValueError where it is not found."""
    point = np.array(start, float)
    for _ in range(iterations):
        residual = return_map(point[None])[0] - point
        if not np.isfinite(residual).all():
            break
        if np.abs(residual).max() < tolerance:
            return point
        jacobian = jacobians(return_map, point[None], steps)[0]
        point = point - np.linalg.lstsq(jacobian - np.eye(len(point)), residual, rcond=None)[0]
    raise ValueError(f"no fixed point found within {iterations} iterations")


def section(flow: Flow, step: float = 2e-2) -> Callable[[Array], Array]:
    """Return map of y > 0 on the axis x = 0, crossed to the right: all states together, classical Runge-Kutta."""

    def advance(state: Array, h: Array | float) -> Array:
        k1 = flow(state)
        k2 = flow(state + h / 2 * k1)
        k3 = flow(state + h / 2 * k2)
        k4 = flow(state + h * k3)
        return np.asarray(state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))

    def return_map(heights: Array) -> Array:
        state = np.concatenate((np.zeros_like(heights), heights), axis=1)
        found = np.full_like(heights, np.nan)
        for index in range(2_000):
            later = advance(state, step)
            crossed = (state[:, 0] < 0) & (later[:, 0] >= 0) & np.isnan(found[:, 0])
            if index and crossed.any():
                there = state[crossed]
                rest = np.zeros((len(there), 1))
                for _ in range(4):  # Newton on the time to the axis
                    now = advance(there, rest)
                    rest = rest - now[:, :1] / flow(now)[:, :1]
                found[crossed] = advance(there, rest)[:, 1:]
            if np.isfinite(found).all():
                break
            state = later
        return found

    return return_map


@pytest.mark.parametrize(("growth", "omega"), [(0.1, 1.0), (0.2, 3.0)])
def test_hopf_normal_form(growth: float, omega: float) -> None:
    """r' = mu r - r^3 turns with omega: r = sqrt(mu), d(r')/dr = -2 mu, multiplier exp(-2 mu 2 pi / omega)."""

    def flow(s: Array) -> Array:
        x, y = s.T
        rate = growth - x**2 - y**2
        return np.stack((rate * x + omega * y, rate * y - omega * x), axis=1)  # clockwise: to the right where y > 0

    steps = np.array([1e-4])
    point = fixed_point(section(flow), np.array([1.3 * np.sqrt(growth)]), steps)
    assert point[0] == pytest.approx(np.sqrt(growth), rel=1e-6)
    found = multipliers(jacobians(section(flow), point[None], steps))
    assert found.values[0] == pytest.approx(np.exp(-4 * np.pi * growth / omega), rel=1e-5)
    assert found.verdict == "stable"


def test_van_der_pol_against_the_divergence_along_its_orbit() -> None:
    """In the plane the multiplier is exp of the integral of the divergence, here mu (1 - x^2), over a period."""
    mu = 0.5

    def flow(s: Array) -> Array:
        x, y = s.T
        return np.stack((y, mu * (1 - x**2) * y - x), axis=1)

    steps = np.array([1e-3])
    point = fixed_point(section(flow), np.array([2.5]), steps)
    found = multipliers(jacobians(section(flow), point[None], steps)).values[0]

    def crossing(t: float, s: Array) -> float:
        return float(s[0])

    crossing.direction = 1
    judge = solve_ivp(
        lambda t, s: [s[1], mu * (1 - s[0] ** 2) * s[1] - s[0], mu * (1 - s[0] ** 2)],
        (0, 10),
        [0.0, point[0], 0.0],
        events=crossing,
        rtol=1e-10,
        atol=1e-12,
    )
    _, height, divergence = judge.y_events[0][judge.t_events[0] > 1][0]  # after one period
    assert height == pytest.approx(point[0], rel=1e-6)
    assert found == pytest.approx(np.exp(divergence), rel=1e-3)


ROTATION = 0.8 * np.array([[np.cos(1), -np.sin(1), 0], [np.sin(1), np.cos(1), 0], [0.3, -0.2, 0.4]])


def test_linear_map() -> None:
    matrix = ROTATION + np.diag([0, 0, -0.1])

    def linear(x: Array) -> Array:
        return x @ matrix.T + [1.0, 2, 3]

    steps = np.array([0.1, 1.0, 10.0])
    np.testing.assert_allclose(jacobians(linear, np.random.default_rng(0).standard_normal((4, 3)), steps)[2], matrix)
    point = fixed_point(linear, np.zeros(3), steps)
    np.testing.assert_allclose(point, np.linalg.solve(np.eye(3) - matrix, [1.0, 2, 3]))
    found = multipliers(jacobians(linear, point[None], steps))
    np.testing.assert_allclose(np.abs(found.values), [0.8, 0.8, 0.22])
    assert np.isnan([found.low, found.high]).all()  # of one matrix
    np.testing.assert_allclose(np.abs(found.slowest @ [0, 0, 1.0]), 0, atol=1e-12)  # a pair, and not the third


def test_an_unstable_map_has_a_fixed_point_and_says_so() -> None:
    def flip(x: Array) -> Array:
        return 1.0 - 1.5 * x**2

    steps = np.array([1e-4])
    point = fixed_point(flip, np.array([0.4]), steps)
    assert point[0] == pytest.approx((np.sqrt(7) - 1) / 3)  # 1.5 x^2 + x - 1 = 0
    found = multipliers(jacobians(flip, point[None], steps))
    assert (found.values[0], found.verdict) == (pytest.approx(-3 * point[0]), "unstable")
    with pytest.raises(ValueError, match="no fixed point"):
        fixed_point(lambda x: np.full_like(x, np.nan), np.array([0.4]), steps)


@pytest.mark.parametrize(("largest", "verdict"), [(0.8, "stable"), (1.0, "undecided"), (1.2, "unstable")])
def test_interval_of_the_mean_of_noisy_matrices(largest: float, verdict: str) -> None:
    rng = np.random.default_rng(1)
    matrices = np.diag([0.3, largest]) + 0.3 * rng.standard_normal((400, 2, 2))
    found = multipliers(matrices)
    assert found.low < largest < found.high
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.3 / np.sqrt(400), rel=0.2)
    assert found.verdict == verdict


def test_decay_of_noisy_responses() -> None:
    rng, matrix = np.random.default_rng(2), ROTATION[:2, :2]
    states = [np.tile([1.0, 0.5], (300, 1))]
    for _ in range(7):
        states.append(states[-1] @ matrix.T)
    responses = np.stack(states, axis=1) + 0.1 * rng.standard_normal((300, 8, 2))
    found = decay(responses)
    assert abs(found.values[0]) == pytest.approx(0.8, abs=0.02)
    assert abs(np.angle(found.values[0])) == pytest.approx(1.0, abs=0.02)
    assert found.low < 0.8 < found.high < 0.83
