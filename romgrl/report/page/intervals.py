"""Intervals of the error table: a bootstrap over the episodes of one evaluation.

Episodes are resampled, not trainings: the interval says how well this evaluation knows the error of these two policies,
and nothing of what another seed would have trained.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import bootstrap

from romgrl.gait.alignment import align, comparable, last_windows
from romgrl.gait.features import CHANNELS, Floats, Gait

RESAMPLES = 9_999
CONFIDENCE = 0.95
SEED = 2021
INTERVAL_ROWS = ("student", "baseline", "reduction_percent")


def error_intervals(teacher: Gait, walkers: Mapping[str, Gait], window: int) -> pd.DataFrame:
    """Ends of the 95% percentile intervals of the aligned error: one row per channel and for their average.

    Columns `<number>_low` and `<number>_high` for student and baseline (m^2) and for reduction_percent; nan where a
    walker has no error or fewer than two episodes. walkers: `student` and `baseline`.
    """
    errors = {name: _errors(gait, teacher, window) for name, gait in walkers.items()}
    shape = (len(INTERVAL_ROWS) * (len(CHANNELS) + 1),)
    low = high = np.full(shape, np.nan)
    if all(len(values) > 1 for values in errors.values()):
        samples = (errors["student"].T, errors["baseline"].T)
        found = bootstrap(
            samples,
            _numbers,
            axis=-1,
            n_resamples=RESAMPLES,
            batch=500,
            confidence_level=CONFIDENCE,
            method="percentile",
            rng=np.random.default_rng(SEED),
        ).confidence_interval
        low, high = found.low, found.high
    table = pd.DataFrame({"channel": [*CHANNELS, "average"]})
    for place, name in enumerate(INTERVAL_ROWS):
        rows = slice(place * len(table), (place + 1) * len(table))
        table[f"{name}_low"], table[f"{name}_high"] = low[rows], high[rows]
    return table


def _numbers(student: Floats, baseline: Floats, axis: int) -> Floats:
    """Errors and reductions (18, ...) of channels and average, from episodes (5, ..., E) along `axis`."""
    errors = [values.mean(axis=axis) for values in (student, baseline)]
    reduction = 100.0 * (1.0 - errors[0] / errors[1])
    return np.concatenate([_with_average(values) for values in (*errors, reduction)])


def _with_average(channels: Any) -> Floats:
    return np.concatenate((channels, channels.mean(axis=0, keepdims=True)))


def _errors(gait: Gait, teacher: Gait, window: int) -> Floats:
    """Error (E, 5) m^2 of each episode without a fall; none where the walker is not comparable."""
    if not comparable(gait):
        return np.zeros((0, len(CHANNELS)))
    return align(last_windows(gait.upright_episodes, window), teacher.upright_episodes).mse
