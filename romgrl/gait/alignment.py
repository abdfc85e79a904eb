"""Distance between gaits that start at different phases.

The last `window` steps of each episode without a fall are laid over every window of the reference that lies within one
of its episodes. One common time shift for all five channels, no time warping: the one with the least error, channels
weighted by their variance

    shift = argmin_s sum_c mean_t (a[t, c] - b[s + t, c])^2 / var_c,      var_c: variance of channel c of the reference.

What is reported is the plain mean squared error of each channel at that shift, in m^2, mean over episodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.gait.features import ALIGNMENTS, CHANNELS, Floats, Gait
from romgrl.gait.metrics import phase_lag, stride_frequency

NOT_COMPARABLE = "not comparable"
SMALLEST_VARIANCE = 1e-8  # m^2; a channel that does not move must not divide by zero


@dataclass(frozen=True)
class Alignment:
    """Windows (E, W, 5) m, the reference windows (E, W, 5) they were laid over, the error (E, 5) m^2 of each pair.

    starts (E, 2): episode and first step of each of those reference windows.
    """

    windows: Floats
    matched: Floats
    mse: Floats
    starts: NDArray[np.int64]


def last_windows(episodes: list[Floats], window: int) -> Floats:
    """The last `window` steps of every episode (T_i, 5) that has as many: (E, W, 5)."""
    kept = [episode[-window:] for episode in episodes if len(episode) >= window]
    return np.asarray(kept, float).reshape(-1, window, len(CHANNELS))


def all_windows(episodes: list[Floats], window: int) -> Floats:
    """Every run of `window` steps that stays within one episode: (S, W, 5), a copy. ValueError where there is none."""
    views = [np.lib.stride_tricks.sliding_window_view(e, window, axis=0) for e in episodes if len(e) >= window]
    if not views:
        longest = max((len(e) for e in episodes), default=0)
        raise ValueError(f"no episode of the reference has {window} steps, the longest has {longest}")
    return np.concatenate(views).transpose(0, 2, 1).astype(float)


def align(windows: Floats, reference: list[Floats], *, raw: bool = False) -> Alignment:
    """Lay each of `windows` (E, W, 5) over the reference's episodes (T_i, 5); raw: over the first window, no shift."""
    candidates = all_windows(reference, windows.shape[1])
    if raw or not len(windows):
        best = np.zeros(len(windows), int)
    else:
        variance = np.maximum(np.concatenate(reference).var(axis=0), SMALLEST_VARIANCE)
        # |a - b|^2 = |a|^2 - 2 a.b + |b|^2, and |a|^2 does not move the minimum over b
        a = (windows / np.sqrt(variance)).reshape(len(windows), -1)
        b = (candidates / np.sqrt(variance)).reshape(len(candidates), -1)
        best = ((b**2).sum(axis=1) - 2 * a @ b.T).argmin(axis=1)
    matched = candidates[best]
    counts = [max(0, len(episode) - windows.shape[1] + 1) for episode in reference]
    starts = np.array([(episode, step) for episode, count in enumerate(counts) for step in range(count)])
    return Alignment(windows, matched, ((windows - matched) ** 2).mean(axis=1), starts[best])


def against_itself(reference: list[Floats], window: int, *, raw: bool = False) -> list[Alignment]:
    """Teacher against teacher: windows of each reference episode laid over the other episodes.

    The windows of an episode do not overlap. A reference of one episode has its last window laid over what comes
    before. Episodes that are too short are left out; none may be left.
    """
    if len(reference) == 1:
        reference = [reference[0][:-window], reference[0][-window:]]
        queries = {1: reference[1][None]}
    else:
        queries = {i: _split(episode, window) for i, episode in enumerate(reference)}
    pairs = []
    for index, query in queries.items():
        others = [e for i, e in enumerate(reference) if i != index and len(e) >= window]
        if others and len(query):
            pairs.append(align(query, others, raw=raw))
    return pairs


def floor(reference: list[Floats], window: int, *, raw: bool = False) -> Floats:
    """The mean error of `against_itself`, (5,) m^2; nan where the reference is too short."""
    pairs = against_itself(reference, window, raw=raw)
    return np.concatenate([pair.mse for pair in pairs]).mean(axis=0) if pairs else np.full(len(CHANNELS), np.nan)


def mse_table(*, reference: Gait, student: Gait, baseline: Gait, window: int) -> pd.DataFrame:
    """mse.csv: one row per channel and alignment, and their average.

    baseline, student, teacher_floor: mean squared error against the reference in m^2. student_episodes,
    baseline_episodes: episodes without a fall, the ones that count. reduction_percent: 100 (1 - student / baseline); in
    the average row the mean of the five channels' reductions, as in the paper's table, not the reduction of the mean
    error. A walker upright in fewer than half of its episodes has no error, and note says "not comparable".
    """
    teacher = reference.upright_episodes
    walkers = {"baseline": baseline, "student": student}
    rows = []
    for alignment in ALIGNMENTS:
        raw = alignment == "raw"
        errors = {name: _mean_error(name, gait, teacher, window, raw=raw) for name, gait in walkers.items()}
        reduction = 100.0 * (1.0 - errors["student"] / np.where(errors["baseline"] > 0, errors["baseline"], np.nan))
        values = {**errors, "reduction_percent": reduction, "teacher_floor": floor(teacher, window, raw=raw)}
        for index, channel in enumerate((*CHANNELS, "average")):
            numbers = {key: float(v.mean() if channel == "average" else v[index]) for key, v in values.items()}
            rows.append({"channel": channel, "alignment": alignment, **numbers})
    table = pd.DataFrame(rows)
    for name in ("student", "baseline"):
        table[f"{name}_episodes"] = int((~walkers[name].fallen).sum())
    table["note"] = objection(walkers)
    return table


def error_over_variance(gait: Gait, reference: Gait, window: int) -> Floats:
    """Error of each channel over the reference's variance, (5,): 0 is the teacher, 1 a statue in its mean pose.

    The last window of each upright episode is laid over one episode of the reference at a time, with one shift; the
    mean over both. An episode is not laid over itself. nan where no episode is upright and long enough.
    """
    teacher = reference.upright_episodes
    variance = np.maximum(np.concatenate(teacher).var(axis=0), SMALLEST_VARIANCE)
    errors = []
    for index, episode in enumerate(gait.upright_episodes):
        if len(episode) >= window:
            others = [e for i, e in enumerate(teacher) if len(e) >= window and (gait is not reference or i != index)]
            errors += [align(episode[None, -window:].astype(float), [other]).mse[0] for other in others]
    return np.mean(errors, axis=0) / variance if errors else np.full(len(CHANNELS), np.nan)


def objection(walkers: Mapping[str, Gait]) -> str:
    """Which of them have no error, and why; "ok" if all have one."""
    objections = [_upright(name, gait) for name, gait in walkers.items() if not comparable(gait)]
    return f"{NOT_COMPARABLE}: {', '.join(objections)}" if objections else "ok"


def aligned_phase_lag(gait: Gait, reference: Gait, window: int) -> tuple[float, float]:
    """`metrics.phase_lag` of the upright episodes' last windows against the teacher: (seconds, teacher's strides)."""
    teacher = reference.upright_episodes
    pairs = align(last_windows(gait.upright_episodes, window), teacher)
    return phase_lag(
        pairs.windows, pairs.matched, gait.dt, stride_frequency(reference.features, gait.dt, reference.valid)
    )


def comparable(gait: Gait) -> bool:
    """At least half of the episodes have no fall."""
    return bool(2 * (~gait.fallen).sum() >= len(gait.fallen))


def _upright(name: str, gait: Gait) -> str:
    return f"{name} upright in {int((~gait.fallen).sum())} of {len(gait.fallen)} episodes"


def _mean_error(name: str, gait: Gait, teacher: list[Floats], window: int, *, raw: bool) -> Floats:
    if not comparable(gait):
        return np.full(len(CHANNELS), np.nan)
    windows = last_windows(gait.upright_episodes, window)
    if not len(windows):
        raise ValueError(f"the episodes of the {name} are shorter than the window of {window} steps")
    return np.asarray(align(windows, teacher, raw=raw).mse.mean(axis=0))


def _split(episode: Floats, window: int) -> Floats:
    """Windows of an episode that do not overlap: (n, W, 5)."""
    count = len(episode) // window
    return episode[: count * window].reshape(count, window, len(CHANNELS))
