"""null_models.csv: what the null models score, beside student, baseline and the reference against itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from romgrl.gait.alignment import last_windows, mean_error, reduction_percent, variances
from romgrl.gait.distances import FLOOR, Row, TeacherScale, from_teacher, of_teacher, scale_of
from romgrl.gait.features import ALIGNMENTS, CHANNELS, Floats
from romgrl.gait.null_models import AVERAGE, MEAN_ERROR, NULL_COLUMNS, OVER_VARIANCE, REDUCTIONS, SCORED, NullModel

Score = tuple[str, str, float]  # measure, channel and value
COLUMN_OF_WALKER = {"teacher": FLOOR, "student": "student", "baseline": "baseline"}
"""Columns of mse.csv and distances.csv, by what the walkers are called here."""


def null_table(
    models: Mapping[str, NullModel],
    reference: list[Floats],
    *,
    errors: pd.DataFrame,
    distances: pd.DataFrame,
    window: int,
    seed: int,
) -> pd.DataFrame:
    """One row per walker, measure and channel; errors, distances: mse.csv and distances.csv of the others.

    error_over_variance: with one shift within one episode of the reference; `average`: mean of the channels.
    <alignment>_reduction_percent: of the error, against the baseline's; `average`: mean of the channels' reductions, as
    in the paper; `mean_error`: reduction of the channels' mean error. mmd, wasserstein, dtw: as in distances.csv.
    """
    scale = scale_of(reference, window)
    error = {name: _errors_in(errors, column) for name, column in COLUMN_OF_WALKER.items()}
    error |= {name: _errors_of(model, reference, window) for name, model in models.items()}
    apart = {name: _distances_in(distances, column) for name, column in COLUMN_OF_WALKER.items()}
    apart |= {name: _distances_of(model, scale, window, seed) for name, model in models.items()}
    rows = []
    for name in (name for name in SCORED if name in error):
        scores = [
            *over_variance(error[name]["one_episode"], variances(reference)),
            *reductions(error[name], error["baseline"]),
            *((*row, value) for row, value in apart[name].items()),
        ]
        rows += [dict(zip(NULL_COLUMNS, (name, *score), strict=True)) for score in scores]
    return pd.DataFrame(rows)


def over_variance(error: Floats, variance: Floats) -> Iterator[Score]:
    """Yield an error (5,) over the reference's variance (5,), and the mean."""
    yield from _with_average(OVER_VARIANCE, error / variance)


def reductions(errors: Mapping[str, Floats], baseline: Mapping[str, Floats]) -> Iterator[Score]:
    """Yield by how much errors (5,) of each alignment are below the baseline's."""
    for alignment, measure in REDUCTIONS.items():
        yield from _with_average(measure, reduction_percent(errors[alignment], baseline[alignment]))
        pooled = reduction_percent(errors[alignment].mean(), baseline[alignment].mean())
        yield measure, MEAN_ERROR, float(pooled)


def _errors_in(errors: pd.DataFrame, column: str) -> dict[str, Floats]:
    """Mean squared error (5,) m^2 by alignment, of a column of mse.csv."""
    channels = errors.set_index(["alignment", "channel"])[column]
    return {each: channels[each][[*CHANNELS]].to_numpy(float) for each in ALIGNMENTS}


def _errors_of(model: NullModel, reference: list[Floats], window: int) -> dict[str, Floats]:
    return {each: mean_error(model.episodes, reference, window, each, own=model.own) for each in ALIGNMENTS}


def _distances_in(distances: pd.DataFrame, column: str) -> dict[Row, float]:
    return {(row["distance"], row["channel"]): float(row[column]) for row in distances.to_dict("records")}


def _distances_of(model: NullModel, scale: TeacherScale, window: int, seed: int) -> dict[Row, float]:
    """Distances from the reference; for what was made of it, of one half from the other."""
    if model.own:
        return of_teacher(scale, window, seed, model.episodes)[0]
    return from_teacher(last_windows(model.episodes, window), scale, seed)[0]


def _with_average(measure: str, values: Floats) -> Iterator[Score]:
    for channel, value in zip((*CHANNELS, AVERAGE), (*values, np.mean(values)), strict=True):
        yield measure, channel, float(value)
