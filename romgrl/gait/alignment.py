"""Distance between gaits that start at different phases.

The last `window` steps of each episode without a fall are laid over windows of the reference. One common time shift for
all five channels, no time warping: the one with the least error, channels weighted by their variance

    shift = argmin_s sum_c mean_t (a[t, c] - b[s + t, c])^2 / var_c,      var_c: variance of channel c of the reference.

    aligned      s runs over every window of all episodes of the reference: the nearest of them all
    one_episode  s runs over the windows of one episode; mean over the reference's episodes
    raw          no shift: the first window of the reference

What is reported is the plain mean squared error of each channel at that shift, in m^2, mean over episodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

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
        variance = variances(reference)
        # |a - b|^2 = |a|^2 - 2 a.b + |b|^2, and |a|^2 does not move the minimum over b
        a = (windows / np.sqrt(variance)).reshape(len(windows), -1)
        b = (candidates / np.sqrt(variance)).reshape(len(candidates), -1)
        best = ((b**2).sum(axis=1) - 2 * a @ b.T).argmin(axis=1)
    matched = candidates[best]
    counts = [max(0, len(episode) - windows.shape[1] + 1) for episode in reference]
    starts = np.array([(episode, step) for episode, count in enumerate(counts) for step in range(count)])
    return Alignment(windows, matched, ((windows - matched) ** 2).mean(axis=1), starts[best])


def against_itself(
    reference: list[Floats], window: int, *, raw: bool = False, made: list[Floats] | None = None
) -> list[Alignment]:
    """Teacher against teacher: windows of each reference episode laid over the other episodes.

    The windows of an episode do not overlap. A reference of one episode has its last window laid over what comes
    before. Episodes that are too short are left out; none may be left. made: episodes made of the reference's, one for
    one, whose windows are laid over the others in their place.
    """
    made = reference if made is None else made
    if len(reference) == 1:
        reference, queries = [reference[0][:-window], reference[0][-window:]], {1: last_windows(made, window)}
    else:
        queries = {i: _split(episode, window) for i, episode in enumerate(made)}
    pairs = []
    for index, query in queries.items():
        others = [e for i, e in enumerate(reference) if i != index and len(e) >= window]
        if others and len(query):
            pairs.append(align(query, others, raw=raw))
    return pairs


def in_one_episode(
    episodes: list[Floats], reference: list[Floats], window: int, *, own: bool = False
) -> list[Alignment]:
    """The last window of each episode laid over one episode of the reference at a time, with one shift.

    own: `episodes` are the reference's, or made of them one for one, and none is laid over its own.
    """
    long = [index for index, episode in enumerate(episodes) if len(episode) >= window]
    pairs = []
    for index, other in enumerate(reference):
        windows = [episodes[i][-window:] for i in long if not (own and i == index)]
        if windows and len(other) >= window:
            pairs.append(align(last_windows(windows, window), [other]))
    return pairs


def mean_error(
    episodes: list[Floats], reference: list[Floats], window: int, alignment: str, *, own: bool = False
) -> Floats:
    """Mean squared error of episodes (T_i, 5) against the reference's, (5,) m^2; nan where there is nothing to lay.

    own: as in `in_one_episode`. The floor of the reference is its own error.
    """
    if alignment == "one_episode":
        pairs = in_one_episode(episodes, reference, window, own=own)
    elif own:
        pairs = against_itself(reference, window, raw=alignment == "raw", made=episodes)
    else:
        pairs = [align(last_windows(episodes, window), reference, raw=alignment == "raw")]
    errors = np.concatenate([pair.mse for pair in pairs]) if pairs else np.zeros((0, len(CHANNELS)))
    return np.asarray(errors.mean(axis=0)) if len(errors) else np.full(len(CHANNELS), np.nan)


def mse_table(*, reference: Gait, student: Gait, baseline: Gait, window: int) -> pd.DataFrame:
    """mse.csv: one row per channel and alignment, and their average.

    baseline, student, teacher_floor: mean squared error against the reference in m^2; the floor is that of each episode
    of the reference against its others. student_episodes, baseline_episodes: episodes without a fall, the ones that
    count. reduction_percent: 100 (1 - student / baseline); in the average row the mean of the five channels'
    reductions, as in the paper's table, not the reduction of the mean error. A walker upright in fewer than half of its
    episodes has no error, and note says "not comparable".
    """
    teacher = reference.upright_episodes
    walkers = {"baseline": baseline, "student": student}
    scored = {name: scored_episodes(name, gait, window) for name, gait in walkers.items()}
    rows = []
    for alignment in ALIGNMENTS:
        errors = {name: mean_error(each, teacher, window, alignment) for name, each in scored.items()}
        reduction = reduction_percent(errors["student"], errors["baseline"])
        floor = mean_error(teacher, teacher, window, alignment, own=True)
        values = {**errors, "reduction_percent": reduction, "teacher_floor": floor}
        for index, channel in enumerate((*CHANNELS, "average")):
            numbers = {key: float(v.mean() if channel == "average" else v[index]) for key, v in values.items()}
            rows.append({"channel": channel, "alignment": alignment, **numbers})
    table = pd.DataFrame(rows)
    for name in ("student", "baseline"):
        table[f"{name}_episodes"] = int((~walkers[name].fallen).sum())
    table["note"] = objection(walkers)
    return table


def reduction_percent(error: ArrayLike, baseline: ArrayLike) -> Floats:
    """By how much an error is below the baseline's; nan where the baseline has none."""
    known = np.where(np.asarray(baseline) > 0, baseline, np.nan)
    return np.asarray(100.0 * (1.0 - np.asarray(error) / known))


def scored_episodes(name: str, gait: Gait, window: int) -> list[Floats]:
    """The episodes that count; none of a walker that is not comparable. Raises ValueError where all are too short."""
    episodes = gait.upright_episodes if comparable(gait) else []
    if episodes and max(map(len, episodes)) < window:
        raise ValueError(f"the episodes of the {name} are shorter than the window of {window} steps")
    return episodes


def variances(reference: list[Floats]) -> Floats:
    """Variance of each channel over all of the reference, (5,) m^2."""
    return np.asarray(np.maximum(np.concatenate(reference).var(axis=0), SMALLEST_VARIANCE))


def error_over_variance(gait: Gait, reference: Gait, window: int) -> Floats:
    """Error of each channel over the reference's variance, (5,): 0 is the teacher, 1 a statue in its mean pose.

    With one shift within one episode of the reference (`in_one_episode`), mean over upright episodes and the
    reference's. nan where no episode is upright and long enough.
    """
    teacher = reference.upright_episodes
    error = mean_error(gait.upright_episodes, teacher, window, "one_episode", own=gait is reference)
    return np.asarray(error / variances(teacher))


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


def _split(episode: Floats, window: int) -> Floats:
    """Windows of an episode that do not overlap: (n, W, 5)."""
    count = len(episode) // window
    return episode[: count * window].reshape(count, window, len(CHANNELS))
