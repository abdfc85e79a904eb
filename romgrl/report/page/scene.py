"""What the player draws: the end of each recorded episode as points in the sagittal plane."""

from __future__ import annotations

import base64
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from romgrl.gait.alignment import align
from romgrl.gait.features import BODY_Y, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Bools, Floats, Gait
from romgrl.report.page.strides import contacts, landings

PLAYER_TIME = 10.0  # s
MILLIMETRES = 1000.0  # per metre: points travel as whole millimetres in 16 bits


@dataclass(frozen=True)
class Track:
    """T steps of one recorded episode, the first of which is shown `offset` steps after the player's start.

    features (T, 5) m; velocity (T,) m/s; contact (T, 2); points (T, P, 2) m, forward of x (T,) m and above the ground.
    """

    features: Floats
    velocity: Floats
    contact: Bools
    points: Floats
    x: Floats
    dt: float
    offset: int = 0

    @property
    def end(self) -> int:
        """Steps from the player's start to the end of the track."""
        return self.offset + len(self.x)

    @property
    def strides(self) -> list[int]:
        """Steps from the player's start at which the left foot lands."""
        return [self.offset + step for step in landings(self.features, self.contact[:, 0], self.dt)]


@dataclass(frozen=True)
class DrawnSegment:
    """A part of the body, drawn as a thick line between two points: radius in m, and whether it is of the far side."""

    radius: float
    far: bool


def humanoid_track(gait: Gait, states: Floats, model: Any) -> Track:
    """The end of the recorded episode, the first of the longest. states (T, nq or more): of that episode."""
    episode = int(gait.valid.sum(axis=1).argmax())
    stop = len(states)
    kept = slice(max(0, stop - round(PLAYER_TIME / gait.dt)), stop)
    points, x = humanoid_points(model, states[kept])
    velocity = np.zeros(len(x)) if gait.velocity is None else gait.velocity[episode, kept]
    return Track(gait.features[episode, kept], velocity, contacts(gait)[episode, kept], points, x, gait.dt)


def teacher_track(teacher: Gait, beside: Track, window: int) -> Track:
    """An episode of the teacher, in time with a walker over the last `window` steps, as the error table lays them."""
    lengths = teacher.valid.sum(axis=1)
    span = int(min(len(beside.x), lengths.max()))
    window = min(window, span)
    long_enough = np.flatnonzero(lengths >= span)
    ends = [teacher.features[episode, teacher.valid[episode]][span - window :] for episode in long_enough]
    place, start = align(beside.features[None, -window:], ends).starts[0]
    episode, first = int(long_enough[place]), int(teacher.valid[long_enough[place]].argmax() + start)
    kept = slice(first, first + span)
    velocity = np.zeros(span) if teacher.velocity is None else teacher.velocity[episode, kept]
    features = teacher.features[episode, kept]
    contact = contacts(teacher)[episode, kept]
    points, x = rom_points(features), gone(velocity, teacher.dt)
    return Track(features, velocity, contact, points, x, teacher.dt, beside.end - span)


def gone(velocity: Floats, dt: float) -> Floats:
    """How far (T,) m a walker is from where it began, by its velocity (T,) m/s."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * dt))


def rom_points(features: Floats) -> Floats:
    """Hip, left and right foot (T, 3, 2) of the reduced-order model, forward of the hip and above the ground."""
    height = features[:, BODY_Y]
    hip = np.stack((np.zeros(len(height)), height), axis=1)
    left = np.stack((features[:, LEFT_X], height + features[:, LEFT_Z]), axis=1)
    right = np.stack((features[:, RIGHT_X], height + features[:, RIGHT_Z]), axis=1)
    return np.stack((hip, left, right), axis=1)


def segments(model: Any, far: Collection[str]) -> list[DrawnSegment]:
    """The drawn parts of a humanoid: one for each of its geoms; `far` names the bodies of the far side."""
    shapes = _shapes(model)
    return [DrawnSegment(radius, model.body(model.geom_bodyid[geom]).name in far) for geom, _, _, radius in shapes]


def humanoid_points(model: Any, states: Floats) -> tuple[Floats, Floats]:
    """Both ends of every segment (T, 2S, 2) m, forward of the root, and the root's x (T,) m."""
    import mujoco

    data, shapes = mujoco.MjData(model), _shapes(model)
    geoms = [geom for geom, _, _, _ in shapes]
    axes, halves = [axis for _, axis, _, _ in shapes], np.array([half for _, _, half, _ in shapes])
    points, x = np.zeros((len(states), len(shapes), 2, 2)), np.zeros(len(states))
    for step, state in enumerate(states):
        data.qpos[:] = state[: model.nq]
        mujoco.mj_kinematics(model, data)
        x[step] = data.xpos[model.jnt_bodyid[0], 0]
        centre = data.geom_xpos[geoms][:, [0, 2]] - [x[step], 0.0]
        turned = data.geom_xmat[geoms].reshape(-1, 3, 3)[np.arange(len(geoms)), :, axes][:, [0, 2]]
        reach = halves[:, None] * turned
        points[step] = np.stack((centre - reach, centre + reach), axis=1)
    return points.reshape(len(states), -1, 2), x


def scene(
    tracks: Mapping[str, Track], parts: list[DrawnSegment], feet: Mapping[str, float], dt: float
) -> dict[str, Any]:
    """All that the player needs, for JSON; feet: foot_radius and roll_over_radius of the model, m.

    Arrays are 16-bit integers, base64: points and x in millimetres.
    """
    walkers = {
        name: recording(track.points, track.x, track.contact, track.strides, track.offset)
        for name, track in tracks.items()
    }
    return {
        "dt": dt,
        "steps": max(track.end for track in tracks.values()),
        "first": max(track.offset for track in tracks.values()),
        "segments": [[round(part.radius, 4), int(part.far)] for part in parts],
        **feet,
        "walkers": walkers,
    }


def recording(points: Floats, x: Floats, contact: Bools, strides: list[int], offset: int = 0) -> dict[str, Any]:
    """One walker of the player: points (T, P, 2) m, x (T,) m, contact (T, 2), and what else a Track says of them."""
    return {
        "offset": offset,
        "steps": len(x),
        "points": encoded(points),
        "x": [round(float(value), 3) for value in x - x[0]],
        "contact": contact.astype(int).tolist(),
        "strides": strides,
    }


def encoded(points: Floats) -> str:
    """Metres as little-endian 16-bit millimetres in base64; what lies beyond 32 m is clipped."""
    whole = np.clip(np.round(points * MILLIMETRES), -32768, 32767).astype("<i2")
    return base64.b64encode(whole.tobytes()).decode("ascii")


def _shapes(model: Any) -> list[tuple[int, int, float, float]]:
    """Geom, its axis in the plane, half length and radius in m of the thick line that stands for it.

    A capsule is one; an ellipsoid or a box is the line along its longer axis in the plane, as wide as the shorter one.
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = []
    for geom in np.flatnonzero(model.geom_bodyid > 0).tolist():
        size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            found.append((geom, 0, 0.0, float(size[0])))
        elif kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
            found.append((geom, 2, float(size[1]), float(size[0])))
        else:
            sideways = np.abs(data.geom_xmat[geom].reshape(3, 3)[1])
            short, long = sorted(np.argsort(sideways)[:2].tolist(), key=lambda axis: float(size[axis]))
            found.append((geom, long, float(size[long] - size[short]), float(size[short])))
    return found
