"""What joints and feet bear, in numbers: free functions on flags at the rate of the physics, (E, T, S, 2) with S
substeps per control step of `dt` s, left and right foot last.

`valid` (E, T) marks the control steps that count. nan where nothing can be told.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Bools, Floats, GaitLoads

LONGEST_GAP = 0.1
"""A foot that leaves the ground for less than this, s, has not ended its stance: swings take 0.3 s and more."""
SHORTEST_STANCE = 0.05
"""A contact that lasts less, s, is a foot that scuffs in its swing: stances take 0.15 s and more."""
FEWEST_STANCE_STEPS = 3
"""Control steps, of a stance and of the gap between two; at 30 Hz they last five and more."""
STANCE_POINTS = 51
LOAD_MEASURES = (
    "stop_torque_share",
    "ankle_stop_percent",
    "contact_bouts",
    "sliding_percent",
    "step_time_asymmetry_percent",
)
"""Columns of gait.csv."""


def peak_force(ground_force: Floats, valid: Bools) -> float:
    """Largest force under a foot in a stance, mean over the stances that begin and end among the valid steps, N.

    ground_force (E, T, 2) N, means over a control step, which are a few percent below what the peak itself is.
    """
    return _mean(np.array([stance.max() for stance in stance_forces(ground_force, valid)]))


def stance_forces(ground_force: Floats, valid: Bools) -> list[Floats]:
    """The force under a foot in each whole stance (steps,), N; ground_force (E, T, 2) N, valid (E, T)."""
    feet = [foot for episode, mask in zip(ground_force, valid, strict=True) for foot in episode[mask].T]
    return [foot[start:stop] for foot in feet for start, stop in whole_stances(foot > 0)]


def whole_stances(contact: Bools) -> list[tuple[int, int]]:
    """The stances among `whole_runs` of contact (T,), in control steps.

    A foot that leaves the ground for fewer than FEWEST_STANCE_STEPS has not ended its stance; one that touches it for
    fewer scuffs.
    """
    runs = whole_runs(without_gaps(contact, FEWEST_STANCE_STEPS))
    return [(start, stop) for start, stop in runs if stop - start >= FEWEST_STANCE_STEPS]


def whole_runs(flags: Bools) -> list[tuple[int, int]]:
    """Where flags (T,) hold: the first step of each run of them that begins and ends within, and the first one after
    it."""
    edges = np.diff(flags.astype(int))
    starts, stops = np.flatnonzero(edges > 0) + 1, np.flatnonzero(edges < 0) + 1
    return [(int(start), int(stops[stops > start][0])) for start in starts if (stops > start).any()]


def force_valley(ground_force: Floats, valid: Bools) -> float:
    """Least force between the humps of a stance over the lower of the two, of the mean over whole stances.

    1 where there is one hump; of people who walk at their own pace 0.73 (Perry & Burnfield 2010). ground_force
    (E, T, 2) N, means over a control step; valid (E, T).
    """
    share = np.linspace(0.0, 1.0, STANCE_POINTS)
    curves = [np.interp(share, np.linspace(0.0, 1.0, len(each)), each) for each in stance_forces(ground_force, valid)]
    if not curves:
        return float("nan")
    mean, middle = np.mean(curves, axis=0), STANCE_POINTS // 2
    first, second = int(mean[:middle].argmax()), middle + int(mean[middle:].argmax())
    return float(mean[first : second + 1].min() / min(mean[first], mean[second]))


def net_extension(features: Floats, contact: Bools, valid: Bools) -> float:
    """How much longer legs are when they leave the ground than when they touch it, mean over whole stances, m.

    features (E, T, 5) m, contact (E, T, 2), valid (E, T). A leg that touches down is as long as in the step before; one
    that leaves as in its last step on the ground or the first one off it, where it is longer: both within a control
    step, in which motors move.
    """
    found = []
    for foot, x, z in ((0, LEFT_X, LEFT_Z), (1, RIGHT_X, RIGHT_Z)):
        length = np.hypot(features[..., x], features[..., z])
        for legs, feet, mask in zip(length, contact[..., foot], valid, strict=True):
            lengths = legs[mask]
            found += [
                max(lengths[stop - 1], lengths[stop]) - lengths[start - 1] for start, stop in whole_stances(feet[mask])
            ]
    return _mean(np.array(found))


def describe_loads(loads: GaitLoads | None, valid: Bools, dt: float) -> dict[str, float]:
    """LOAD_MEASURES, nan where no loads were recorded."""
    nan = float("nan")
    if loads is None:
        return dict.fromkeys(LOAD_MEASURES, nan)
    touching, loaded = ((flags & valid[..., None, None]) for flags in (loads.touching, loads.loaded))
    values = (
        float(loads.stop_share[valid].max()) if valid.any() else nan,
        100 * _mean(loads.ankle_stop[touching]),
        contact_bouts(touching, valid, dt),
        100 * _mean(loads.sliding[loaded]),
        100 * step_time_asymmetry(touching, valid, dt),
    )
    return dict(zip(LOAD_MEASURES, values, strict=True))


def contact_bouts(touching: Bools, valid: Bools, dt: float) -> float:
    """Touchdowns per stance: 1 where a foot that has landed stays until it swings, more where it chatters or scuffs."""
    landings = sum(len(landed(foot)) for foot in _feet(touching, valid))
    count = sum(len(landed(stances(foot, dt / touching.shape[2]))) for foot in _feet(touching, valid))
    return landings / count if count else float("nan")


def step_time_asymmetry(touching: Bools, valid: Bools, dt: float) -> float:
    """|t_left - t_right| over their mean: t from a touchdown of one foot to the next one of the other, means."""
    timestep = dt / touching.shape[2]
    times: tuple[list[float], list[float]] = ([], [])
    feet = list(_feet(touching, valid))
    for left, right in zip(feet[::2], feet[1::2], strict=True):
        touchdowns = [(step, 0) for step in landed(stances(left, timestep))]
        touchdowns += [(step, 1) for step in landed(stances(right, timestep))]
        for (start, foot), (stop, other) in pairwise(sorted(touchdowns)):
            if foot != other:
                times[foot].append((stop - start) * timestep)
    if not all(times):
        return float("nan")
    first, second = (float(np.mean(each)) for each in times)
    return abs(first - second) / (0.5 * (first + second))


def stances(contact: Bools, timestep: float) -> Bools:
    """The same contact (N,) without the gaps within a stance, and without what is too short to be one."""
    closed = without_gaps(contact, round(LONGEST_GAP / timestep))
    lifts = np.flatnonzero(closed[:-1] & ~closed[1:]) + 1
    for landing in landed(closed):
        after = lifts[lifts > landing]
        if len(after) and (after[0] - landing) * timestep < SHORTEST_STANCE:
            closed[landing : after[0]] = False
    return closed


def landed(contact: Bools) -> NDArray[np.int64]:
    """Substeps at which a foot lands. contact: (N,)."""
    return np.flatnonzero(contact[1:] & ~contact[:-1]) + 1


def without_gaps(contact: Bools, longest: int) -> Bools:
    """The same contact (N,) with gaps of fewer than `longest` substeps closed."""
    closed = contact.copy()
    lifts, lands = np.flatnonzero(contact[:-1] & ~contact[1:]) + 1, landed(contact)
    for lift in lifts:
        after = lands[lands > lift]
        if len(after) and after[0] - lift < longest:
            closed[lift : after[0]] = True
    return closed


def _feet(touching: Bools, valid: Bools) -> list[Bools]:
    """Contact (N,) over the valid substeps of each episode, left foot and right foot in turn."""
    return [flags[mask].reshape(-1, 2)[:, foot] for flags, mask in zip(touching, valid, strict=True) for foot in (0, 1)]


def _mean(values: Floats | Bools) -> float:
    return float(values.mean()) if values.size else float("nan")
