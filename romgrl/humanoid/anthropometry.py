"""Sizes, masses and strengths of the project's own humanoid.

Masses, lengths, centres of mass and radii of gyration are the male means of P. de Leva, "Adjustments to
Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomechanics 29 (1996) 1223-1230, table 4 (subjects of 1.741 m).
Ankle, hip and shoulder positions that the table does not give are fractions of the height from D. A. Winter,
"Biomechanics and Motor Control of Human Movement" (2009), figure 4.1.
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
