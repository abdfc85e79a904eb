"""Period, shift and likeness of sampled signals."""

from __future__ import annotations

import numpy as np

from romgrl.gait.features import Floats

SMALLEST_SWING = 0.02  # m; a signal that moves less than this does not swing
REVERSAL = 0.3  # of the range between the 5th and the 95th percentile


def frequency(signals: Floats, dt: float) -> float:
    """Swings per second of signals (T, S) that swing at the same rate, mean over signals; nan where fewer than two do.

    A swing ends in a maximum that lies REVERSAL of the signal's range above the minima on both sides, so that noise
    does not count and swings of different height do. The rate is (n - 1) / (time from first to last of n maxima).
    """
    rates = []
    for signal in signals.T:
        maxima = swing_maxima(signal)
        if len(maxima) > 1:
            first, last = (index + vertex(signal, index) for index in (maxima[0], maxima[-1]))
            rates.append((len(maxima) - 1) / ((last - first) * dt))
    return float(np.mean(rates)) if rates else float("nan")


def swing_maxima(signal: Floats) -> list[int]:
    """Steps of the maxima that end a swing of `signal` (T,); see `frequency`."""
    low, high = np.percentile(signal, (5, 95)) if len(signal) else (0.0, 0.0)
    if high - low < SMALLEST_SWING:
        return []
    reversal = REVERSAL * (high - low)
    maxima, best, rising = [], 0, False
    for step, value in enumerate(signal):
        if (value > signal[best]) if rising else (value < signal[best]):
            best = step
        elif abs(value - signal[best]) > reversal:
            if rising:
                maxima.append(best)
            rising, best = not rising, step
    return maxima


def lag(signal: Floats, reference: Floats, reach: int) -> float:
    """Steps, within +- reach, by which `signal` (T,) comes after `reference` (T,): where their correlation peaks."""
    a, b = signal - signal.mean(), reference - reference.mean()
    score = np.array([_overlap_correlation(a, b, shift) for shift in range(-reach, reach + 1)])
    best = int(score.argmax())
    return best - reach + vertex(score, best)


def vertex(values: Floats, index: int) -> float:
    """Offset in (-0.5, 0.5) of the vertex of the parabola through a peak and its neighbours."""
    if not 0 < index < len(values) - 1:
        return 0.0
    left, centre, right = values[index - 1 : index + 2]
    curvature = left - 2 * centre + right
    return float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5)) if curvature < 0 else 0.0


def concordance(left: Floats, right: Floats, shift: float) -> float:
    """Lin's concordance of left(t) with right(t + shift), shift in steps, linear interpolation."""
    times = np.arange(len(left) - int(np.ceil(shift)))
    a, b = left[times], np.interp(times + shift, np.arange(len(right)), right)
    scale = a.var() + b.var() + (a.mean() - b.mean()) ** 2
    return float(2 * ((a - a.mean()) * (b - b.mean())).mean() / scale) if scale > 1e-12 else 1.0


def _overlap_correlation(a: Floats, b: Floats, shift: int) -> float:
    """Correlation of a(t + shift) with b(t) over the steps they share."""
    first, second = (a[shift:], b[: len(b) - shift]) if shift >= 0 else (a[:shift], b[-shift:])
    norm = np.sqrt((first**2).sum() * (second**2).sum())
    return float((first * second).sum() / norm) if norm > 1e-12 else 0.0
