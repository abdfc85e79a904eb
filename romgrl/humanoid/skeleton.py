"""What the bodies of a humanoid are called, how they hang together, and the sign conventions of every angle.

World: x forward, y left, z up. Every hinge turns about the lateral axis (world +y): a positive angle moves what is
above the joint forward and what hangs below it backward. Hence hip flexion is negative, knee flexion positive, ankle
plantarflexion positive, spine flexion positive, arm raised forward negative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from romgrl.config import worlds
from romgrl.config.values import refusal
from romgrl.gait.symmetry import Mirror, by_name

OWN_SKELETON: Final = worlds.SKELETONS[0]
"""The value of `humanoid.skeleton` for the project's own humanoid."""
ROOT_JOINTS: Final = ("root_x", "root_z", "root_pitch")
SKELETON_TEXT: Final = "romgrl_skeleton"
"""Text element of a built model that names its skeleton."""

MOST_BODIES: Final = 64
"""kMostBodies of cpp/humanoid/planar_bodies.hpp."""


class Limbs(NamedTuple):
    """The bodies of a leg and of an arm by their joints; None where there is no arm."""

    hip: str
    knee: str
    ankle: str
    shoulder: str | None = None
    elbow: str | None = None


@dataclass(frozen=True)
class Skeleton:
    """Names and tree of a humanoid's bodies, and what part each plays."""

    name: str
    """The value of `humanoid.skeleton`."""
    parents: Mapping[str, str]
    """Parent of every body but the root, in the order of the model's bodies; files may have further bodies."""
    sides: tuple[str, str]
    """What the names of left and of right bodies begin or end with."""
    left: Limbs
    trunk: tuple[str, ...]
    """The hinges between the root and the head, which stay nearly upright at a reset."""
    neck: str
    """The line from the root to this body is the trunk, whose lean is measured."""
    head: str
    pushed: str
    """The body that pushes act on."""
    welded: frozenset[str] = frozenset()
    """Bodies without a hinge."""
    base_quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Orientation of the standing root; each of its axes lies along one of the world's, one of them forward."""

    def __post_init__(self) -> None:
        parts = {*self.left, *self.right, *self.trunk, *self.welded, self.neck, self.head, self.pushed} - {None}
        unknown = sorted(str(part) for part in parts - set(self.bodies))
        if unknown:
            raise ValueError(f"skeleton {self.name}: {unknown[0]} is none of its bodies")
        if len(self.bodies) > MOST_BODIES:
            raise ValueError(f"skeleton {self.name}: {len(self.bodies)} bodies, {MOST_BODIES} at most")
        for index, (body, parent) in enumerate(self.parents.items(), start=1):
            if parent not in self.bodies[:index]:
                raise ValueError(f"skeleton {self.name}: {body}'s parent {parent} must come before it")
        turned = np.round(self.base_rotation, 6)
        if set(np.abs(turned).ravel()) != {0.0, 1.0} or turned[0].max() < 1:
            raise ValueError(f"skeleton {self.name}: {self.base_quaternion} turns no axis of the root forward")

    @property
    def root(self) -> str:
        """The pelvis, which every other body hangs from."""
        return next(iter(self.parents.values()))

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """All bodies (B,), in the order of the model's."""
        return (self.root, *self.parents)

    @cached_property
    def hinges(self) -> tuple[str, ...]:
        """The bodies (A,) that turn about a pitch hinge, in the order of the actions."""
        return tuple(body for body in self.parents if body not in self.welded)

    @cached_property
    def column(self) -> dict[str, int]:
        """Column of each hinge's angle in qpos, and of its speed in qvel."""
        return {name: len(ROOT_JOINTS) + index for index, name in enumerate(self.hinges)}

    @property
    def right(self) -> Limbs:
        """The other side of `left`."""
        hip, knee, ankle, *arm = (self.other_side(name) if name else "" for name in self.left)
        return Limbs(hip, knee, ankle, *(name or None for name in arm))

    @property
    def feet(self) -> tuple[frozenset[str], frozenset[str]]:
        """The bodies of the left and of the right foot: the ankle's and all that hang from it."""
        return self._below(self.left.ankle), self._below(self.right.ankle)

    @property
    def right_side(self) -> frozenset[str]:
        """All bodies of the right side."""
        side = self.sides[1]
        return frozenset(body for body in self.bodies if body.startswith(side) or body.endswith(side))

    @property
    def observation_size(self) -> int:
        """Height, then for each body a position (but the root's), two axes and two velocities."""
        return 1 + 3 * (len(self.bodies) - 1) + (6 + 3 + 3) * len(self.bodies)

    @cached_property
    def base_rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) of the standing root."""
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, np.array(self.base_quaternion))
        return matrix.reshape(3, 3)

    @property
    def axes(self) -> tuple[int, int, int]:
        """Which of the standing root's axes, x (0), y (1) or z (2), lies along the world's x, y and z."""
        forward, lateral, up = np.abs(self.base_rotation).argmax(axis=1).tolist()
        return forward, lateral, up

    def other_side(self, name: str) -> str:
        """The name of the mirrored body: L_Hip -> R_Hip; Head -> Head."""
        for side, other in (self.sides, self.sides[::-1]):
            if name.startswith(side):
                return other + name.removeprefix(side)
            if name.endswith(side):
                return name.removesuffix(side) + other
        return name

    def mirror_action(self) -> Mirror:
        """Mirror of the actions (A,); pitch angles keep their sign."""
        return by_name(self.hinges, self.other_side)

    def mirror_joints(self) -> Mirror:
        """Mirror of the planar qpos and qvel (3 + A,)."""
        return by_name((*ROOT_JOINTS, *self.hinges), self.other_side)

    def _below(self, body: str) -> frozenset[str]:
        found = {body}
        for child, parent in self.parents.items():
            if parent in found:
                found.add(child)
        return frozenset(found)


_LEG: Final = {"Hip": "Pelvis", "Knee": "Hip", "Ankle": "Knee", "Toe": "Ankle"}
_TRUNK: Final = {"Torso": "Pelvis", "Spine": "Torso", "Chest": "Spine", "Neck": "Chest", "Head": "Neck"}
_ARM: Final = {"Thorax": "Chest", "Shoulder": "Thorax", "Elbow": "Shoulder", "Wrist": "Elbow", "Hand": "Wrist"}


def _side(side: str, chain: Mapping[str, str]) -> dict[str, str]:
    return {side + body: parent if parent in ("Pelvis", "Chest") else side + parent for body, parent in chain.items()}


SMPL: Final = Skeleton(
    name=OWN_SKELETON,
    parents=_side("L_", _LEG) | _side("R_", _LEG) | _TRUNK | _side("L_", _ARM) | _side("R_", _ARM),
    sides=("L_", "R_"),
    left=Limbs("L_Hip", "L_Knee", "L_Ankle", "L_Shoulder", "L_Elbow"),
    trunk=("Torso", "Spine", "Chest", "Neck", "Head"),
    neck="Neck",
    head="Head",
    pushed="Chest",
    welded=frozenset(("L_Hand", "R_Hand")),
    base_quaternion=(0.5, 0.5, 0.5, 0.5),
)
"""SMPL's 24 bodies. Frames of a standing humanoid: local x left, y up, z forward."""

SKELETONS: Final = {skeleton.name: skeleton for skeleton in (SMPL,)}
"""Every value of `humanoid.skeleton`."""


def without_file(name: str) -> str:
    """The line of a skeleton that is not the project's own where `humanoid.xml` names no file."""
    return refusal("humanoid.skeleton", name, f"{OWN_SKELETON} without humanoid.xml")


def skeleton_of(model: mujoco.MjModel) -> Skeleton:
    """The skeleton that a model was built with; SMPL's for a model that was not built here."""
    text = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, SKELETON_TEXT)
    if text < 0:
        return SMPL
    first = model.text_adr[text]
    return SKELETONS[model.text_data[first : first + model.text_size[text] - 1].decode()]
