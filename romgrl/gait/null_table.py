"""null_models.csv: student, baseline and null models, all scored in the same way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from romgrl.gait.alignment import last_windows, mean_error, reduction_percent, variances
from romgrl.gait.distances import TeacherScale, from_teacher, of_teacher, scale_of
from romgrl.gait.features import ALIGNMENTS, CHANNELS, Floats
from romgrl.gait.null_models import AVERAGE, MEAN_ERROR, NULL_COLUMNS, OVER_VARIANCE, REDUCTIONS, SCORED, ScoredWalker

Score = tuple[str, str, float]  # measure, channel and value


def null_table(walkers: Mapping[str, ScoredWalker], reference: list[Floats], *, window: int, seed: int) -> pd.DataFrame:
    """One row per walker, measure and channel. walkers: `baseline` among them; one without episodes has no values.

    error_over_variance: with one shift within one episode of the reference; `average`: mean of the channels.
    <alignment>_reduction_percent: of the error, against the baseline's; `average`: mean of the channels' reductions, as
    in the paper; `mean_error`: reduction of the channels' mean error. mmd, wasserstein, dtw: as in distances.csv.
    """
    scale = scale_of(reference, window)
    errors = {name: errors_of(each, reference, window) for name, each in walkers.items()}
    rows = []
    for name in (name for name in SCORED if name in walkers):
        scores = [
            *over_variance(errors[name]["one_episode"], variances(reference)),
            *reductions(errors[name], errors["baseline"]),
            *distances_of(walkers[name], scale, window, seed),
        ]
        rows += [dict(zip(NULL_COLUMNS, (name, *score), strict=True)) for score in scores]
    return pd.DataFrame(rows)


def errors_of(walker: ScoredWalker, reference: list[Floats], window: int) -> dict[str, Floats]:
    """Mean squared error (5,) m^2 by alignment."""
    return {each: mean_error(walker.episodes, reference, window, each, own=walker.own) for each in ALIGNMENTS}


def over_variance(error: Floats, variance: Floats) -> Iterator[Score]:
    """Yield an error (5,) over the reference's variance (5,), and the mean."""
    yield from _with_average(OVER_VARIANCE, error / variance)


def reductions(errors: Mapping[str, Floats], baseline: Mapping[str, Floats]) -> Iterator[Score]:
    """Yield by how much errors (5,) of each alignment are below the baseline's."""
    for alignment, measure in REDUCTIONS.items():
        yield from _with_average(measure, reduction_percent(errors[alignment], baseline[alignment]))
        pooled = reduction_percent(errors[alignment].mean(), baseline[alignment].mean())
        yield measure, MEAN_ERROR, float(pooled)


def distances_of(walker: ScoredWalker, scale: TeacherScale, window: int, seed: int) -> Iterator[Score]:
    """Yield each distance from the reference; for what was made of it, of one half from the other."""
    if walker.own:
        found, _ = of_teacher(scale, window, seed, walker.episodes)
    else:
        found, _ = from_teacher(last_windows(walker.episodes, window), scale, seed)
    for (distance, channel), value in found.items():
        yield distance, channel, value


def _with_average(measure: str, values: Floats) -> Iterator[Score]:
    for channel, value in zip((*CHANNELS, AVERAGE), (*values, np.mean(values)), strict=True):
        yield measure, channel, float(value)
