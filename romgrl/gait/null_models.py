"""Walkers that learned nothing, made of the reference: what any gait must be compared with before it is called good.

statue     the mean pose of the reference, without a motion
sinusoid   each channel a cosine: the reference's mean, amplitude and phase at its cadence, at twice that for the
           pelvis of a gait whose feet take turns; the right foot is the left one half a stride later there, with it
           in a hop, and as much later as it is in other gaits
stretched  the reference played faster or slower, at another cadence
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import ALIGNMENTS, BODY_Y, CHANNELS, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Floats
from romgrl.gait.footfall import ALTERNATING
from romgrl.gait.periodicity import frequency

SCORED = ("teacher", "other_teacher", "stretched", "student", "sinusoid", "statue", "baseline")  # in this order
NULL_COLUMNS = ("walker", "measure", "channel", "value")  # of null_models.csv
OVER_VARIANCE = "error_over_variance"
REDUCTIONS = {alignment: f"{alignment}_reduction_percent" for alignment in ALIGNMENTS}
AVERAGE, MEAN_ERROR = "average", "mean_error"  # mean of the channels' reductions, reduction of the channels' mean error
ONCE = np.ones(len(CHANNELS), int)
TWICE = np.where(np.arange(len(CHANNELS)) == BODY_Y, 2, ONCE)
"""Cosines per stride of each channel: of a gait whose body rises once in a stride, and of one whose feet take turns."""


@dataclass(frozen=True)
class NullModel:
    """Episodes (T_i, 5) m to be scored; `own`: made of the reference's, one for one, so that none meets its own."""

    episodes: list[Floats]
    own: bool = False


@dataclass(frozen=True)
class FirstHarmonic:
    """x[c] = mean[c] + Re(amplitude[c] exp(i sines[c] phase)), mean (5,) m, amplitude (5,) complex, m."""

    mean: Floats
    amplitude: NDArray[np.complexfloating]
    sines: NDArray[np.int_]

    def at(self, phase: Floats) -> Floats:
        """Features (T, 5) at phases (T,) of the stride, rad."""
        turned = np.exp(1j * phase[:, None] * self.sines)
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

    The feet are made one: the right foot is the left one turned by `foot_turn`.
    """
    cadences = [frequency(episode[:, [LEFT_X, RIGHT_X]], dt) for episode in reference]
    phases = [
        (episode, 2 * np.pi * cadence * dt * np.arange(len(episode)))
        for episode, cadence in zip(reference, cadences, strict=True)
        if cadence > 0
    ]
    turn = foot_turn([_fitted(episode, phase, ONCE)[1] for episode, phase in phases])
    sines = TWICE if turn == -1 else ONCE
    means, amplitudes = [], []
    for episode, phase in phases:
        mean, amplitude = _fitted(episode, phase, sines)
        for left, right in ((LEFT_X, RIGHT_X), (LEFT_Z, RIGHT_Z)):
            amplitude[left] = 0.5 * (amplitude[left] + amplitude[right] * np.conj(turn))
            amplitude[right] = amplitude[left] * turn
        means.append(mean)
        amplitudes.append(amplitude * np.exp(-1j * np.angle(amplitude[LEFT_X]) * sines))
    return FirstHarmonic(np.mean(means, axis=0), np.mean(amplitudes, axis=0), sines)


def foot_turn(amplitudes: list[NDArray[np.complexfloating]]) -> complex:
    """How far the right foot's x is turned from the left one's, of size 1; amplitudes: (5,) of each episode.

    -1, half a stride, where the feet take turns, and 1 where they go together.
    """
    turn = sum(each[RIGHT_X] * np.conj(each[LEFT_X]) for each in amplitudes)
    turn = complex(turn / abs(turn)) if turn else -1.0
    return -1.0 if turn.real < ALTERNATING else 1.0 if turn.real > -ALTERNATING else turn


def stretched(episode: Floats, factor: float) -> Floats:
    """An episode (T, 5) at `factor` times its cadence, linear between steps; a factor of 1 changes nothing."""
    steps = np.arange(len(episode))
    at = factor * np.arange(int((len(episode) - 1) / factor) + 1)
    return np.stack([np.interp(at, steps, channel) for channel in episode.T], axis=1)


def _fitted(episode: Floats, phase: Floats, cosines: NDArray[np.int_]) -> tuple[Floats, NDArray[np.complexfloating]]:
    """Mean (5,) and complex amplitude (5,) of the cosines that fit an episode (T, 5) best; phase (T,) rad."""
    mean, amplitude = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS), complex)
    for channel, sines in enumerate(cosines):
        basis = np.stack((np.ones_like(phase), np.cos(sines * phase), -np.sin(sines * phase)), axis=1)
        mean[channel], real, imaginary = np.linalg.lstsq(basis, episode[:, channel], rcond=None)[0]
        amplitude[channel] = real + 1j * imaginary
    return mean, amplitude
