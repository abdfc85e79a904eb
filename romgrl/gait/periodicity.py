"""Period, shift and likeness of sampled signals."""

from __future__ import annotations

import numpy as np

from romgrl.gait.features import Floats

SLOWEST, FASTEST = 0.3, 5.0  # repetitions per second, the band searched


def frequency(signals: Floats, dt: float) -> float:
    """Repetitions per second of signals (T, S) that repeat together, nan where nothing does.

    The period is the earliest peak of the unbiased autocorrelation, summed over signals, that reaches 0.8 of the
    highest one within 0.2-3.3 s (so that no multiple is taken for it), refined at the last multiple inside T / 2.
    """
    steps = len(signals)
    shortest = max(2, int(1.0 / (FASTEST * dt)))
    longest = min(int(1.0 / (SLOWEST * dt)), int(0.75 * steps))
    centred = signals - signals.mean(axis=0)
    if longest - shortest < 3 or centred.std() < 1e-6:
        return float("nan")
    spectrum = np.fft.rfft(centred, 2 * steps, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:steps].sum(axis=1) / np.arange(steps, 0, -1)
    correlation /= correlation[0]
    inner = np.arange(shortest, longest)
    peaks = inner[(correlation[inner] >= correlation[inner - 1]) & (correlation[inner] > correlation[inner + 1])]
    peaks = peaks[correlation[peaks] > 0.3]
    if not len(peaks):
        return float("nan")
    first = int(peaks[correlation[peaks] >= 0.8 * correlation[peaks].max()][0])
    period = first + vertex(correlation, first)
    for multiple in range(2, int(0.5 * steps / period) + 1):
        centre = round(multiple * period)
        near = np.arange(max(centre - first // 4, 1), min(centre + first // 4 + 1, steps - 1))
        best = int(near[correlation[near].argmax()])
        period = (best + vertex(correlation, best)) / multiple
    return 1.0 / (period * dt)


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
