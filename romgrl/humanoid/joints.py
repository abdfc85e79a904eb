"""What the joints of the project's own humanoid can do: ranges, passive moments, strength and servo targets.

Ranges are the passive ones of healthy adults (hip and knee: Roaas and Andersson 1982, Acta Orthop. Scand. 53:205; ankle
under load: Bennell et al. 1998, Aust. J. Physiother. 44:175). Hip, knee and ankle resist as R. Riener and T. Edrich
measured, J. Biomechanics 32 (1999) 539-544, with the damping of D. T. Davy and M. L. Audu, J. Biomechanics 20 (1987)
187-201, and are as strong as strong young men on D. E. Anderson's dynamometer (J. Biomechanics 40 (2007) 3105-3113).
Rotations are backward positive: hip and ankle extend, the knee bends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.metrics import GRAVITY

Floats = NDArray[np.float64]

ECCENTRIC: Final = 1.4
"""Largest torque against the motion over the isometric one: 1.3 to 1.5 in voluntary contractions (Anderson's fits
leave the data beyond some rad/s)."""
FITTED_SPEEDS: Final = np.linspace(-10.0, 10.0, 201)
"""Where the straight line is fitted to the curve of torque over speed, rad/s: what hips, knees and ankles of a runner
show."""


@dataclass(frozen=True)
class Strength:
    """Anderson et al. (2007), table 3, men of 18 to 25: torque as a share of weight x height, speeds in rad/s."""

    mean: float
    deviation: float
    three_quarters: float
    """Speed at which 75% of the isometric torque is left."""
    half: float
    """Speed at which 50% is left."""

    def isometric(self, height: float, mass: float) -> float:
        """Largest torque at rest of a strong young man, two deviations above the mean, N m."""
        return (self.mean + 2 * self.deviation) * mass * GRAVITY * height

    def share(self, speed: Floats) -> Floats:
        """Share of the isometric torque at a speed (rad/s), shortening positive: equation 3, at most ECCENTRIC."""
        a, b = self.three_quarters, self.half
        shortening = (2 * a * b + speed * (b - 3 * a)) / (2 * a * b + speed * (2 * b - 4 * a))
        lengthening = 1 + (ECCENTRIC - 1) * np.minimum(1.0, -speed / b)
        return np.where(speed < 0, lengthening, np.maximum(shortening, 0.0))


@dataclass(frozen=True)
class Motor:
    """A straight line of torque over speed, as MuJoCo's DC motor has it, N m and rad/s, and the range of its torque."""

    stall: float
    no_load: float
    low: float
    high: float


def motor(forward: Strength, backward: Strength, height: float, mass: float) -> Motor:
    """The line fitted to the curves of both directions; forward turns are negative.

    The stronger direction gives the stall torque, and reaches ECCENTRIC times its isometric torque; the weaker one,
    whose line lies too high, never exceeds its own.
    """
    lines = [np.polyfit(FITTED_SPEEDS, strength.share(FITTED_SPEEDS), 1) for strength in (forward, backward)]
    low, high = (strength.isometric(height, mass) for strength in (forward, backward))
    stall = max(low, high) * max(float(offset) for _, offset in lines)
    no_load = max(float(-offset / slope) for slope, offset in lines)
    return Motor(stall, no_load, -low * (ECCENTRIC if low > high else 1.0), high * (ECCENTRIC if high > low else 1.0))


@dataclass(frozen=True)
class Joint:
    """A pitch hinge: range and servo target in rad, servo in N m/rad and N m, damping in N m s/rad."""

    low: float
    high: float
    neutral: float
    """Servo target at action 0."""
    reach: float
    """Servo targets at action -1 and 1 are neutral -+ reach."""
    stiffness: float
    damping: float
    strength: float | tuple[Strength, Strength]
    """Largest torque of the servo; two: forward and backward, which fall with speed."""
    armature: float = 0.02
    passive: Callable[[Floats], Floats] | None = None
    """Passive elastic moment (N,) in N m at angles (N,) in rad."""


def hip_moment(angle: Floats) -> Floats:
    """Riener and Edrich's equation for the hip with the knee bent by KNEE."""
    flexion = -np.degrees(angle)
    return -(
        np.exp(1.4655 - 0.0034 * KNEE - 0.0750 * flexion) - np.exp(1.3403 - 0.0226 * KNEE + 0.0305 * flexion) + 8.072
    )


def knee_moment(angle: Floats) -> Floats:
    """The same for the knee, hip and ankle at HIP and 0."""
    flexion = np.degrees(angle)
    flexing = np.exp(1.800 - 0.0352 * flexion + 0.0217 * HIP) + np.exp(2.220 - 0.150 * flexion)
    return flexing - np.exp(-3.971 + 0.0495 * flexion - 0.0128 * HIP) - 4.820


def ankle_moment(angle: Floats) -> Floats:
    """The same for the ankle, the knee bent by KNEE."""
    flexion = np.degrees(angle)  # plantar
    extending = np.exp(2.1016 - 0.0843 * flexion - 0.0176 * KNEE)
    return extending - np.exp(-7.9763 + 0.1949 * flexion + 0.0008 * KNEE) - 1.792


KNEE: Final = 40.0
HIP: Final = 20.0
"""Angles of the neighbouring joints, degrees, means of a run: muscles across two joints couple their moments."""

HIP_STRENGTH: Final = Strength(0.113, 0.025, 2.095, 4.267), Strength(0.161, 0.049, 1.578, 3.190)
KNEE_STRENGTH: Final = Strength(0.163, 0.040, 1.517, 3.952), Strength(0.087, 0.015, 2.008, 5.233)
ANKLE_STRENGTH: Final = Strength(0.033, 0.005, 0.699, 1.940), Strength(0.095, 0.022, 0.987, 3.558)
"""Forward and backward: hip flexion and extension, knee extension and flexion, dorsi- and plantarflexion."""

JOINTS: Final[dict[str, Joint]] = {
    "Hip": Joint(-2.1, 0.70, -0.35, 1.0, 250.0, 1.09, HIP_STRENGTH, passive=hip_moment),
    "Knee": Joint(0.0, 2.5, 0.60, 1.1, 250.0, 3.17, KNEE_STRENGTH, passive=knee_moment),
    "Ankle": Joint(-0.65, 0.87, 0.0, 0.7, 300.0, 0.943, ANKLE_STRENGTH, passive=ankle_moment),
    "Toe": Joint(-1.2, 0.6, 0.0, 0.3, 40.0, 0.5, 40.0, 0.01),
    "Torso": Joint(-0.3, 0.50, 0.04, 0.20, 800.0, 20.0, 220.0),
    "Spine": Joint(-0.3, 0.40, 0.04, 0.15, 800.0, 20.0, 200.0),
    "Chest": Joint(-0.3, 0.40, 0.02, 0.10, 800.0, 20.0, 180.0),
    "Neck": Joint(-0.6, 0.7, 0.0, 0.15, 80.0, 3.0, 50.0),
    "Head": Joint(-0.5, 0.5, 0.0, 0.10, 60.0, 2.0, 40.0),
    "Thorax": Joint(-0.3, 0.3, 0.0, 0.05, 150.0, 4.0, 120.0),
    "Shoulder": Joint(-2.6, 1.0, 0.0, 0.8, 40.0, 1.5, 60.0),
    "Elbow": Joint(-2.5, 0.0, -1.4, 0.4, 20.0, 0.7, 40.0, 0.01),
    "Wrist": Joint(-1.0, 1.0, 0.0, 0.2, 5.0, 0.2, 10.0, 0.01),
}
"""Hinges of one side; left and right are the same."""


def spring(joint: Joint) -> tuple[tuple[float, float, float], float]:
    """MuJoCo's polynomial spring nearest to the passive moment over the range: coefficients a, b, c and rest angle.

    moment(q) = -(a x + b x^2 + c x^3), x = q - rest. Nothing where there is no passive moment.
    """
    if joint.passive is None:
        return (0.0, 0.0, 0.0), 0.0
    angles = np.linspace(joint.low, joint.high, 200)
    cubic = np.polynomial.Polynomial.fit(angles, joint.passive(angles), 3).convert()
    roots = cubic.roots()
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real > joint.low) & (real < joint.high) & (cubic.deriv()(real) < 0)]
    rest = float(inside[0])
    shifted = cubic(np.polynomial.Polynomial([rest, 1.0]))
    a, b, c = (-float(value) for value in shifted.coef[1:4])
    return (a, b, c), rest
