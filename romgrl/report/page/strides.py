"""Strides of a recorded gait: from one touchdown of the left foot to the next."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from romgrl.gait.features import CHANNELS, Bools, Floats, Gait
from romgrl.gait.metrics import infer_contact, steady_steps, stride_frequency, touchdowns

PHASES = np.linspace(0.0, 1.0, 51)
USUAL = (0.6, 1.5)  # strides as long, in usual ones, count; shorter and longer ones are stumbles and missed touchdowns


@dataclass(frozen=True)
class StrideAverage:
    """Mean and standard deviation (51, 5) m of the channels over the phase of a stride, and over how many strides."""

    mean: Floats
    deviation: Floats
    strides: int


def contacts(gait: Gait) -> Bools:
    """Feet on the ground (E, T, 2): as recorded, else guessed from the motion."""
    if gait.contact is not None:
        return gait.contact
    velocity = np.zeros(gait.features.shape[:2]) if gait.velocity is None else gait.velocity
    return infer_contact(gait.features, velocity, gait.dt, gait.valid)


def landings(features: Floats, contact: Bools, dt: float) -> list[int]:
    """Steps at which the left foot begins a stride: features (T, 5), its contact (T,).

    A touchdown sooner than USUAL[0] of a stride after the last one is the same landing, bounced.
    """
    rate = stride_frequency(features[None], dt)
    steps = touchdowns(contact) if rate > 0 else []
    kept = steps[:1]
    for step in steps[1:]:
        if (step - kept[-1]) * dt * rate >= USUAL[0]:
            kept.append(step)
    return kept


def phases(steps: int, starts: list[int], offset: int) -> Floats:
    """Phase in [0, 1) of `steps` steps from step `offset` on, linear between touchdowns; nan before and after them."""
    times = np.arange(offset, offset + steps)
    if len(starts) < 2:
        return np.full(steps, np.nan)
    return np.asarray(np.interp(times, starts, np.arange(len(starts)), left=np.nan, right=np.nan) % 1.0)


def stride_average(gait: Gait) -> StrideAverage | None:
    """Over the strides of all episodes once they are steady; None where no whole stride is like others."""
    valid, feet = steady_steps(gait.valid, gait.dt), contacts(gait)
    curves = []
    for episode in range(len(valid)):
        features, contact = gait.features[episode, valid[episode]], feet[episode, valid[episode], 0]
        curves += _strides(features, landings(features, contact, gait.dt))
    usual = float(np.median([length for length, _ in curves])) if curves else 0.0
    kept = [curve for length, curve in curves if USUAL[0] * usual <= length <= USUAL[1] * usual]
    return StrideAverage(np.mean(kept, axis=0), np.std(kept, axis=0), len(kept)) if kept else None


def _strides(features: Floats, starts: list[int]) -> list[tuple[int, Floats]]:
    """Length in steps and channels (51, 5) of each stride."""
    found: list[tuple[int, Floats]] = []
    for start, stop in pairwise(starts):
        at = start + PHASES * (stop - start)
        steps = np.arange(start, stop + 1)
        curve = [np.interp(at, steps, features[start : stop + 1, channel]) for channel in range(len(CHANNELS))]
        found.append((stop - start, np.stack(curve, axis=1)))
    return found
