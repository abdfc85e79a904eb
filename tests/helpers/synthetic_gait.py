"""Gaits with known numbers: feet on sine paths, rectangular contact."""

from __future__ import annotations

import numpy as np

from romgrl.gait.features import Bools, Floats

DT = 1.0 / 30.0


def run(
    *,
    episodes: int = 4,
    steps: int = 300,
    frequency: float = 1.73,
    right_phase: float = 0.5,
    amplitude: float = 0.4,
    duty: float = 0.3,
    height: float = 0.9,
    excursion: float = 0.08,
    noise: float = 0.0,
    seed: int = 0,
    dt: float = DT,
) -> tuple[Floats, Bools]:
    """Features (E, T, 5) and contact (E, T, 2); the right foot's stride starts `right_phase` after the left's."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 1, (episodes, 1))
    left = frequency * dt * np.arange(steps) + start
    right = left - right_phase
    features = np.stack(
        [
            height - 0.5 * excursion * np.cos(4 * np.pi * left),
            amplitude * np.cos(2 * np.pi * left),
            -0.75 + 0.1 * np.maximum(0, -np.sin(2 * np.pi * left)),
            amplitude * np.cos(2 * np.pi * right),
            -0.75 + 0.1 * np.maximum(0, -np.sin(2 * np.pi * right)),
        ],
        axis=-1,
    )
    contact = np.stack([left % 1.0 < duty, right % 1.0 < duty], axis=-1)
    return features + noise * rng.standard_normal(features.shape), contact
