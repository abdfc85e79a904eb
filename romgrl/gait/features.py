"""The feature contract that every gait of the project is written in.

    features[t] = [y_com, x_left, y_left, x_right, y_right]      float32, metres, x forward, y up

y_com is the height of the body above the ground; the ankles follow, relative to the body. The body is the pelvis origin
of the humanoid or the trunk centre of the reduced-order model, the ankle the joint or the centre of the foot circle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.symmetry import unsigned

ALIGNMENTS = {
    "aligned": "nearest window of all episodes",
    "one_episode": "one shift within one episode",
    "raw": "no shift",
}  # what a window is laid over in the reference, in words; all channels are shifted together
ALL = "all"  # channels together
CHANNELS = ("pelvis_y", "left_foot_x", "left_foot_z", "right_foot_x", "right_foot_z")
MIRROR = unsigned((0, 3, 4, 1, 2))
POWERS = ("power", "positive_power", "retraction_power", "positive_retraction_power")
"""What actuators do, W, means over a control step: absolute values and positive ones alone, summed over the actuators;
of the scripted retraction of a reduced-order model's legs alone."""
BODY_Y, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z = range(5)

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]


def until_first_fall(upright: Bools) -> Bools:
    """True from the start of each episode up to, not including, the first step that is not upright. Shape: (E, T)."""
    return np.asarray(np.logical_and.accumulate(upright, axis=1), bool)


@dataclass(frozen=True)
class GaitLoads:
    """What joints and feet bear, of E episodes of T control steps of S substeps; see `romgrl.humanoid.loads.Loads`."""

    stop_share: Floats  # (E, T)
    touching: Bools  # (E, T, S, 2)
    loaded: Bools
    sliding: Bools
    ankle_stop: Bools


LOADS = tuple(field.name for field in fields(GaitLoads))


@dataclass(frozen=True)
class Gait:
    """Episodes of one walker, padded to one length.

    features (E, T, 5) m; valid (E, T): steps that belong to the episode, before any fall; fallen (E,); dt s;
    velocity (E, T) m/s forward; contact (E, T, 2) left and right foot on the ground; trunk_lean (E, T) rad, forward
    positive; POWERS (E, T) W, of actuators, absolute and positive, of all and of the
    retraction alone; ground_force (E, T, 2) N, normal, mean over a control step; loads. None: not recorded.
    """

    features: Floats
    valid: Bools
    fallen: Bools
    dt: float
    velocity: Floats | None = None
    contact: Bools | None = None
    trunk_lean: Floats | None = None
    power: Floats | None = None
    positive_power: Floats | None = None
    retraction_power: Floats | None = None
    positive_retraction_power: Floats | None = None
    ground_force: Floats | None = None
    loads: GaitLoads | None = None

    @property
    def upright_episodes(self) -> list[Floats]:
        """Features (T_i, 5) of the episodes without a fall."""
        return [self.features[e, self.valid[e]] for e in np.flatnonzero(~self.fallen)]


def gait_from_rollouts(arrays: Mapping[str, NDArray[np.generic]], name: str) -> Gait:
    """One walker of rollouts.npz: arrays `<name>_features`, `<name>_upright`, ... and `dt`."""

    def optional(key: str) -> NDArray[np.generic] | None:
        return arrays.get(f"{name}_{key}")

    upright = np.asarray(arrays[f"{name}_upright"], bool)
    contact = optional("contact")
    return Gait(
        features=np.asarray(arrays[f"{name}_features"], float),
        valid=until_first_fall(upright),
        fallen=np.logical_not(upright.all(axis=1)),
        dt=float(arrays["dt"]),
        velocity=_float(optional("velocity")),
        contact=None if contact is None else np.asarray(contact, bool),
        trunk_lean=_float(optional("trunk_lean")),
        **_powers(optional),
        loads=_loads(arrays, name),
    )


def gait_from_reference(arrays: Mapping[str, NDArray[np.generic]]) -> Gait:
    """The teacher's rollout, reference.npz: `features` (N, 5), `episode` (N,), `dt`, optionally other fields of Gait.

    A change of the episode number starts a new episode.
    """
    bounds = episode_bounds(np.asarray(arrays["episode"]))
    lengths = [stop - start for start, stop in bounds]
    valid = np.arange(max(lengths)) < np.asarray(lengths)[:, None]

    def padded(key: str) -> NDArray[np.generic] | None:
        values = arrays.get(key)
        if values is None:
            return None
        result = np.zeros((*valid.shape, *values.shape[1:]), values.dtype)
        for row, (start, stop) in enumerate(bounds):
            result[row, : stop - start] = values[start:stop]
        return result

    features, contact = padded("features"), padded("contact")
    if features is None:
        raise ValueError("the reference has no array `features`")
    return Gait(
        features=np.asarray(features, float),
        valid=valid,
        fallen=np.zeros(len(bounds), bool),
        dt=float(arrays["dt"]),
        velocity=_float(padded("velocity")),
        contact=None if contact is None else np.asarray(contact, bool),
        trunk_lean=_float(padded("trunk_lean")),
        **_powers(padded),
    )


def episode_bounds(episode: NDArray[np.generic]) -> list[tuple[int, int]]:
    """Start and stop of every run of equal numbers in `episode` (N,)."""
    if len(episode) == 0:
        raise ValueError("a reference needs at least one step")
    cuts = np.flatnonzero(episode[1:] != episode[:-1]) + 1
    edges = [0, *cuts.tolist(), len(episode)]
    return list(pairwise(edges))


def _loads(arrays: Mapping[str, NDArray[Any]], name: str) -> GaitLoads | None:
    found = {key: arrays[f"{name}_{key}"] for key in LOADS if f"{name}_{key}" in arrays}
    return GaitLoads(**found) if found.keys() == set(LOADS) else None


def _powers(recorded: Callable[[str], NDArray[np.generic] | None]) -> dict[str, Any]:
    return {name: _float(recorded(name)) for name in POWERS}


def _float(values: NDArray[np.generic] | None) -> Floats | None:
    return None if values is None else np.asarray(values, float)
