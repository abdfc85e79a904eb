"""An independent judge: three distances between a walker and the teacher that no training has seen.

    mmd          maximum mean discrepancy over runs of a few frames (`romgrl.gait.mmd`), squared, no unit
    wasserstein  first Wasserstein distance of each channel's values, m: the area between both distribution functions
    dtw          dynamic time warping of the scored windows over the nearest window of all the reference's episodes
                 (`romgrl.gait.dtw`)

The first two do not know when a frame came, the third does. `all` sums up the five channels: for wasserstein their mean
in standard deviations of the teacher, for dtw the distance itself, likewise; the channels of dtw are its parts in m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import wasserstein_distance

from romgrl.gait.alignment import (
    Alignment,
    against_itself,
    align,
    comparable,
    last_windows,
    objection,
    variances,
)
from romgrl.gait.dtw import warped_distance
from romgrl.gait.features import ALL, CHANNELS, Floats, Gait
from romgrl.gait.mmd import median_distance, mmd_test, points

DISTANCES = ("mmd", "wasserstein", "dtw")
DEVIATIONS = "teacher's standard deviations"
UNITS = {("mmd", ALL): "1", ("wasserstein", ALL): DEVIATIONS, ("dtw", ALL): DEVIATIONS}
FLOOR = "teacher_floor"
Row = tuple[str, str]  # distance and channel


@dataclass(frozen=True)
class TeacherScale:
    """The reference's episodes (T_i, 5), a window of the end of each (N, W, 5), mean and standard deviation (5,) m."""

    episodes: list[Floats]
    windows: Floats
    mean: Floats
    deviation: Floats
    bandwidth: float

    def standardised(self, windows: Floats) -> Floats:
        """Windows (..., 5) without unit."""
        return np.asarray((windows - self.mean) / self.deviation)


def measure_distances(*, reference: Gait, student: Gait, baseline: Gait, window: int, seed: int) -> pd.DataFrame:
    """distances.csv: one row per distance and channel.

    baseline, student: distance of the scored windows, the last `window` steps of the episodes without a fall, from the
    reference; teacher_floor: of one half of the reference's episodes from the other half (dtw: of each episode from the
    others). baseline_p, student_p, floor_p: how often chance alone gives as much, for mmd. A walker upright in fewer
    than half of its episodes has no distance, and note says "not comparable".
    """
    teacher = scale_of(reference.upright_episodes, window)
    walkers = {"baseline": baseline, "student": student}
    found: dict[str, dict[Row, float]] = {}
    chance: dict[str, float] = {}
    for name, gait in walkers.items():
        windows = last_windows(gait.upright_episodes if comparable(gait) else [], window)
        found[name], chance[f"{name}_p"] = from_teacher(windows, teacher, seed)
    found[FLOOR], chance["floor_p"] = of_teacher(teacher, window, seed)
    rows = []
    for distance, channel in [("mmd", ALL), *((each, c) for each in DISTANCES[1:] for c in (*CHANNELS, ALL))]:
        key = distance, channel
        values = {name: each.get(key, float("nan")) for name, each in found.items()}
        p = chance if distance == "mmd" else dict.fromkeys(chance, float("nan"))
        rows.append({"distance": distance, "channel": channel, **values, **p, "unit": UNITS.get(key, "m")})
    return pd.DataFrame(rows).assign(note=objection(walkers))


def scale_of(episodes: list[Floats], window: int) -> TeacherScale:
    """What the distances need of the reference; one episode alone is cut into windows."""
    windows, frames = last_windows(_blocks(episodes, window), window), np.concatenate(episodes)
    mean, deviation = frames.mean(axis=0), np.sqrt(variances(episodes))
    bandwidth = median_distance(points((windows - mean) / deviation))
    return TeacherScale(episodes, windows, mean, deviation, bandwidth)


def from_teacher(windows: Floats, teacher: TeacherScale, seed: int) -> tuple[dict[Row, float], float]:
    """Every distance of a walker's windows (E, W, 5) from the teacher and the p of mmd; none without windows."""
    if not len(windows):
        return {}, float("nan")
    mmd, p = mmd_test(teacher.standardised(windows), teacher.standardised(teacher.windows), teacher.bandwidth, seed)
    apart = wasserstein(windows.reshape(-1, len(CHANNELS)), np.concatenate(teacher.episodes), teacher.deviation)
    return {("mmd", ALL): mmd, **apart, **warped([align(windows, teacher.episodes)], teacher)}, p


def of_teacher(
    teacher: TeacherScale, window: int, seed: int, made: list[Floats] | None = None
) -> tuple[dict[Row, float], float]:
    """The same of one half of the teacher's episodes from the other; of a single episode, of its halves.

    made: episodes made of the teacher's, one for one, the first half of which is compared in their place.
    """
    made = teacher.episodes if made is None else made
    first, second = _blocks(made, window)[0::2], _blocks(teacher.episodes, window)[1::2]
    mine, others = (teacher.standardised(last_windows(side, window)) for side in (first, second))
    mmd, p = mmd_test(mine, others, teacher.bandwidth, seed)
    first, second = _parts(made, 2)[0::2], _parts(teacher.episodes, 2)[1::2]
    apart = wasserstein(np.concatenate(first), np.concatenate(second), teacher.deviation)
    return {("mmd", ALL): mmd, **apart, **warped(against_itself(teacher.episodes, window, made=made), teacher)}, p


def wasserstein(frames: Floats, others: Floats, deviation: Floats) -> dict[Row, float]:
    """Distance of the values of each channel, frames (N, 5) and others (M, 5) m, and their mean in deviations (5,)."""
    apart = np.array([wasserstein_distance(a, b) for a, b in zip(frames.T, others.T, strict=True)])
    return _by_channel("wasserstein", apart, float((apart / deviation).mean()))


def warped(pairs: list[Alignment], teacher: TeacherScale) -> dict[Row, float]:
    """DTW of aligned windows, mean over windows; none without pairs."""
    if not pairs:
        return {}
    windows, matched = (np.concatenate([getattr(p, side) for p in pairs]) for side in ("windows", "matched"))
    together, parts = warped_distance(windows, matched, teacher.deviation)
    return _by_channel("dtw", parts.mean(axis=0), float(together.mean()))


def _by_channel(distance: str, values: Floats, together: float) -> dict[Row, float]:
    rows = {(distance, channel): float(value) for channel, value in zip(CHANNELS, values, strict=True)}
    return {**rows, (distance, ALL): together}


def _blocks(episodes: list[Floats], window: int) -> list[Floats]:
    return _parts(episodes, max(1, len(episodes[0]) // window))


def _parts(episodes: list[Floats], count: int) -> list[Floats]:
    """The episodes; one alone is cut into so many parts."""
    return episodes if len(episodes) > 1 else list(np.array_split(episodes[0], count))
