"""Names, tree and mirror image of the 24 segments (SMPL's), and the sign conventions of every angle.

World: x forward, y left, z up. Body frames of a standing humanoid follow SMPL: local x left, y up, z forward, so that
the pelvis has the orientation BASE_QUATERNION. Every hinge turns about the lateral axis (world +y): a positive angle
moves what is above the joint forward and what hangs below it backward. Hence hip flexion is negative, knee flexion
positive, ankle plantarflexion positive, spine flexion positive, arm raised forward negative.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from romgrl.gait.symmetry import Mirror, by_name

BASE_QUATERNION: Final = (0.5, 0.5, 0.5, 0.5)

_LEG: Final = (("Hip", "Pelvis"), ("Knee", "Hip"), ("Ankle", "Knee"), ("Toe", "Ankle"))
_TRUNK: Final = (("Torso", "Pelvis"), ("Spine", "Torso"), ("Chest", "Spine"), ("Neck", "Chest"), ("Head", "Neck"))
_ARM: Final = (
    ("Thorax", "Chest"),
    ("Shoulder", "Thorax"),
    ("Elbow", "Shoulder"),
    ("Wrist", "Elbow"),
    ("Hand", "Wrist"),
)


def _side(side: str, chain: tuple[tuple[str, str], ...]) -> dict[str, str]:
    return {f"{side}_{body}": parent if parent in ("Pelvis", "Chest") else f"{side}_{parent}" for body, parent in chain}


PARENTS: Final[dict[str, str]] = {
    **_side("L", _LEG),
    **_side("R", _LEG),
    **dict(_TRUNK),
    **_side("L", _ARM),
    **_side("R", _ARM),
}
"""Parent of every body but the pelvis, in the order of the model's bodies."""

BODIES: Final[tuple[str, ...]] = ("Pelvis", *PARENTS)
HINGES: Final[tuple[str, ...]] = tuple(body for body in PARENTS if not body.endswith("Hand"))
"""The bodies that turn about a pitch hinge, in the order of the actions; the hands are welded."""

ROOT_JOINTS: Final = ("root_x", "root_z", "root_pitch")


def other_side(name: str) -> str:
    """The name of the mirrored body: L_Hip -> R_Hip; Head -> Head."""
    return {"L_": "R_", "R_": "L_"}.get(name[:2], name[:2]) + name[2:]


def mirror_action() -> Mirror:
    """Mirror of the actions (21,); pitch angles keep their sign."""
    return by_name(HINGES, other_side)


def mirror_joints() -> Mirror:
    """Mirror of the planar qpos and qvel (24,)."""
    return by_name((*ROOT_JOINTS, *HINGES), other_side)


def mirror_observation() -> Mirror:
    """Mirror of the observation (358,) in the sagittal plane.

    With M = diag(1, -1, 1) in the world and S = diag(-1, 1, 1) in the body frames, whose x is lateral, the mirrored
    rotation is M R S: the x column becomes -M R e_x, the z column M R e_z. Angular velocity is a pseudovector.
    """
    bodies = by_name(BODIES, other_side).permutation
    vector, pseudo = np.array([1.0, -1.0, 1.0]), np.array([-1.0, 1.0, -1.0])
    blocks = (  # first column, width per body, first body, sign
        (1, 3, 1, vector),
        (70, 6, 0, np.concatenate([-vector, vector])),
        (214, 3, 0, vector),
        (286, 3, 0, pseudo),
    )
    permutation, sign = [np.zeros(1, dtype=np.int64)], [np.ones(1)]
    for start, width, first, signs in blocks:
        order = bodies[first:] - first
        permutation.append((start + order[:, None] * width + np.arange(width)).ravel())
        sign.append(np.tile(signs, len(order)))
    return Mirror(np.concatenate(permutation), np.concatenate(sign).astype(np.float32))
