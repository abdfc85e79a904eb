"""Sizes, masses and strengths of the project's own humanoid.

Masses, lengths, centres of mass and radii of gyration are the male means of P. de Leva, "Adjustments to
Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomechanics 29 (1996) 1223-1230, table 4 (subjects of 1.741 m).
Ankle, hip and shoulder positions that the table does not give are fractions of the height from D. A. Winter,
"Biomechanics and Motor Control of Human Movement" (2009), figure 4.1. Joint ranges are those of healthy adults;
strengths are near the largest joint moments of running and lifting (Winter, chapter 5: about 3 N m/kg at the knee and
ankle), so that no joint can do what a person's could not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

DE_LEVA_HEIGHT: Final = 1.741
"""Height of the subjects of the table, m: every length scales with height / DE_LEVA_HEIGHT."""


@dataclass(frozen=True)
class Segment:
    """One row of de Leva's table 4: mass share, length in m, and the rest as shares of the length."""

    mass: float
    length: float
    centre: float
    gyration: tuple[float, float, float]
    """Radii of gyration about the sagittal (forward), transverse (lateral) and longitudinal axes."""


DE_LEVA: Final[dict[str, Segment]] = {
    "head": Segment(0.0694, 0.2033, 0.5976, (0.362, 0.376, 0.312)),  # vertex to mid-gonion, centre from the vertex
    "upper_trunk": Segment(0.1596, 0.1707, 0.2999, (0.716, 0.454, 0.659)),  # suprasternale to xiphion
    "middle_trunk": Segment(0.1633, 0.2155, 0.4502, (0.482, 0.383, 0.468)),  # xiphion to omphalion
    "lower_trunk": Segment(0.1117, 0.1457, 0.6115, (0.615, 0.551, 0.587)),  # omphalion to mid-hip
    "upper_arm": Segment(0.0271, 0.2817, 0.5772, (0.285, 0.269, 0.158)),
    "forearm": Segment(0.0162, 0.2689, 0.4574, (0.276, 0.265, 0.121)),
    "hand": Segment(0.0061, 0.0862, 0.7900, (0.628, 0.513, 0.401)),
    "thigh": Segment(0.1416, 0.4222, 0.4095, (0.329, 0.329, 0.149)),
    "shank": Segment(0.0433, 0.4340, 0.4459, (0.255, 0.249, 0.103)),
    "foot": Segment(0.0137, 0.2581, 0.4415, (0.257, 0.245, 0.124)),
}

ANKLE_HEIGHT: Final = 0.039
HIP_HALF_WIDTH: Final = 0.0477  # half of 0.191 between the hips at the trochanters, moved in to the joint centres
SHOULDER_HEIGHT: Final = 0.818
SHOULDER_HALF_WIDTH: Final = 0.104
"""Winter's fractions of the height."""

MASS_SHARES: Final[dict[str, tuple[tuple[str, float], ...]]] = {
    "head": (("Neck", 0.2), ("Head", 0.8)),
    "upper_trunk": (("Chest", 0.8), ("L_Thorax", 0.1), ("R_Thorax", 0.1)),
    "middle_trunk": (("Torso", 0.5), ("Spine", 0.5)),
    "lower_trunk": (("Pelvis", 1.0),),
    "upper_arm": (("Shoulder", 1.0),),
    "forearm": (("Elbow", 1.0),),
    "hand": (("Wrist", 0.6), ("Hand", 0.4)),
    "thigh": (("Hip", 1.0),),
    "shank": (("Knee", 1.0),),
    "foot": (("Ankle", 0.85), ("Toe", 0.15)),
}
"""How the table's segments are shared among SMPL's bodies (of one side for arms and legs)."""


def mass_fraction(body: str) -> float:
    """Share of the body mass of one of the 24 bodies."""
    limb = body.split("_", 1)[-1]
    for segment, shares in MASS_SHARES.items():
        for name, share in shares:
            if name in (body, limb):
                return DE_LEVA[segment].mass * share
    raise ValueError(f"no such body: {body}")


@dataclass(frozen=True)
class Joint:
    """A pitch hinge: range and servo target in rad, servo in N m/rad, N m s/rad and N m."""

    low: float
    high: float
    neutral: float
    """Servo target at action 0."""
    reach: float
    """Servo targets at action -1 and 1 are neutral -+ reach."""
    stiffness: float
    damping: float
    strength: float
    armature: float = 0.02


JOINTS: Final[dict[str, Joint]] = {
    "Hip": Joint(-2.1, 0.44, -0.30, 1.2, 250.0, 8.0, 220.0),
    "Knee": Joint(0.0, 2.4, 0.60, 1.1, 220.0, 5.0, 250.0),
    "Ankle": Joint(-0.5, 0.8, -0.25, 0.7, 200.0, 4.0, 200.0),
    "Toe": Joint(-1.1, 0.4, 0.0, 0.5, 30.0, 0.6, 40.0, 0.01),
    "Torso": Joint(-0.2, 0.40, 0.04, 0.25, 800.0, 40.0, 220.0),
    "Spine": Joint(-0.17, 0.30, 0.04, 0.20, 800.0, 40.0, 200.0),
    "Chest": Joint(-0.15, 0.25, 0.02, 0.15, 800.0, 40.0, 180.0),
    "Neck": Joint(-0.5, 0.6, 0.0, 0.4, 80.0, 4.0, 50.0),
    "Head": Joint(-0.3, 0.4, 0.0, 0.3, 60.0, 3.0, 40.0),
    "Thorax": Joint(-0.15, 0.15, 0.0, 0.10, 150.0, 8.0, 120.0),
    "Shoulder": Joint(-2.6, 1.0, 0.0, 1.0, 60.0, 3.0, 80.0),
    "Elbow": Joint(-2.5, 0.0, -1.2, 1.0, 40.0, 1.5, 60.0, 0.01),
    "Wrist": Joint(-0.8, 0.8, 0.0, 0.5, 10.0, 0.4, 15.0, 0.01),
}
"""Hinges of one side; left and right are the same."""
