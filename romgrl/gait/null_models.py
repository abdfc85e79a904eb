"""Walkers that learned nothing, made of the reference: what any gait must be compared with before it is called good.

statue     the mean pose of the reference, without a motion
sinusoid   each channel a cosine: the reference's mean, amplitude and phase at its cadence, at twice that for the
           pelvis; the right foot is the left one half a stride later
stretched  the reference played faster or slower, at another cadence
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import ALIGNMENTS, BODY_Y, CHANNELS, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Floats
from romgrl.gait.periodicity import frequency

SCORED = ("teacher", "other_teacher", "stretched", "student", "sinusoid", "statue", "baseline")  # in this order
NULL_COLUMNS = ("walker", "measure", "channel", "value")  # of null_models.csv
OVER_VARIANCE = "error_over_variance"
REDUCTIONS = {alignment: f"{alignment}_reduction_percent" for alignment in ALIGNMENTS}
AVERAGE, MEAN_ERROR = "average", "mean_error"  # mean of the channels' reductions, reduction of the channels' mean error
SINES_PER_STRIDE = np.array([2 if channel == BODY_Y else 1 for channel in range(len(CHANNELS))])


@dataclass(frozen=True)
class NullModel:
    """Episodes (T_i, 5) m to be scored; `own`: made of the reference's, one for one, so that none meets its own."""

    episodes: list[Floats]
    own: bool = False


@dataclass(frozen=True)
class FirstHarmonic:
    """x[c] = mean[c] + Re(amplitude[c] exp(i SINES_PER_STRIDE[c] phase)), mean (5,) m, amplitude (5,) complex, m."""

    mean: Floats
    amplitude: NDArray[np.complexfloating]

    def at(self, phase: Floats) -> Floats:
        """Features (T, 5) at phases (T,) of the stride, rad."""
        turned = np.exp(1j * phase[:, None] * SINES_PER_STRIDE)
        return np.asarray(self.mean + (self.amplitude * turned).real)


def null_models(
    reference: list[Floats], dt: float, cadence: float, target: float, window: int
) -> tuple[dict[str, NullModel], dict[str, str]]:
    """The null models, and why others cannot be made. cadence, target: strides/s of the reference and the student."""
    models = {"statue": NullModel(statues(reference, window))}
    absent = {}
    if not cadence > 0:
        absent = dict.fromkeys(("sinusoid", "stretched"), "the reference has no strides")
    else:
        models["sinusoid"] = NullModel(sinusoids(reference, dt, cadence, window))
        if target > 0:
            models["stretched"] = NullModel([stretched(each, target / cadence) for each in reference], own=True)
        else:
            absent["stretched"] = "the student has no strides"
    return models, absent


def statues(reference: list[Floats], steps: int) -> list[Floats]:
    """As many episodes of `steps` steps (T, 5) as the reference has, all in its mean pose."""
    return [np.tile(np.concatenate(reference).mean(axis=0), (steps, 1)) for _ in reference]


def sinusoids(reference: list[Floats], dt: float, cadence: float, steps: int) -> list[Floats]:
    """As many episodes (T, 5) as the reference has, which start evenly spread over the stride."""
    wave, time = first_harmonic(reference, dt), dt * np.arange(steps)
    return [wave.at(2 * np.pi * (cadence * time + start / len(reference))) for start in range(len(reference))]


def first_harmonic(reference: list[Floats], dt: float) -> FirstHarmonic:
    """The least-squares fit to each episode at its own cadence, mean over episodes in phase with the feet's x.

    The feet are made one: half of left minus right, which is what they share half a stride apart.
    """
    means, amplitudes = [], []
    for episode in reference:
        cadence = frequency(episode[:, [LEFT_X, RIGHT_X]], dt)
        if cadence > 0:
            mean, amplitude = _fitted(episode, 2 * np.pi * cadence * dt * np.arange(len(episode)))
            for left, right in ((LEFT_X, RIGHT_X), (LEFT_Z, RIGHT_Z)):
                amplitude[left] = 0.5 * (amplitude[left] - amplitude[right])
                amplitude[right] = -amplitude[left]
            means.append(mean)
            amplitudes.append(amplitude * np.exp(-1j * np.angle(amplitude[LEFT_X]) * SINES_PER_STRIDE))
    return FirstHarmonic(np.mean(means, axis=0), np.mean(amplitudes, axis=0))


def stretched(episode: Floats, factor: float) -> Floats:
    """An episode (T, 5) at `factor` times its cadence, linear between steps; a factor of 1 changes nothing."""
    steps = np.arange(len(episode))
    at = factor * np.arange(int((len(episode) - 1) / factor) + 1)
    return np.stack([np.interp(at, steps, channel) for channel in episode.T], axis=1)


def _fitted(episode: Floats, phase: Floats) -> tuple[Floats, NDArray[np.complexfloating]]:
    """Mean (5,) and complex amplitude (5,) of the cosines that fit an episode (T, 5) best; phase (T,) rad."""
    mean, amplitude = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS), complex)
    for channel, sines in enumerate(SINES_PER_STRIDE):
        basis = np.stack((np.ones_like(phase), np.cos(sines * phase), -np.sin(sines * phase)), axis=1)
        mean[channel], real, imaginary = np.linalg.lstsq(basis, episode[:, channel], rcond=None)[0]
        amplitude[channel] = real + 1j * imaginary
    return mean, amplitude
