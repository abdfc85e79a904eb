"""Walkers whose legs swing at known rates, as recorded gaits and as states of the humanoid."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from romgrl.gait.features import Gait
from romgrl.humanoid.model import build
from tests.helpers import finished
from tests.helpers.swinging import running
from tests.helpers.synthetic_gait import DT, run

EPISODES = 8
RATES = {"student": 1.8, "baseline": 2.4}  # strides/s; the teacher's are 1.75
LEANS = {"student": 0.05, "baseline": 0.3}  # rad


def write_run(folder: Path, *, steps: int, blur: float = 0.01) -> dict[str, Path]:
    """A directory per stage of a run at 4 m/s, its manifests included. blur: noise of the student's features, m."""
    model = build()
    gaits = {
        "teacher": walker(1.75, steps=250, episodes=4),
        "student": walker(RATES["student"], steps=steps, lean=LEANS["student"], height=0.87, noise=blur),
        "baseline": walker(
            RATES["baseline"], steps=steps, lean=LEANS["baseline"], height=0.75, noise=0.01, amplitude=0.3
        ),
    }
    inputs = finished.write(folder, gaits, states(model, steps), speed=4.0)
    finished.write_trainings(inputs)
    return inputs


def states(model: Any, steps: int) -> Mapping[str, Any]:
    """States (T, nq + nv) of student and baseline."""
    return {name: running(model, rate, steps) for name, rate in RATES.items()}


def walker(rate: float, *, steps: int, episodes: int = EPISODES, lean: float = 0.0, **shape: float) -> Gait:
    """Episodes of a synthetic run at 4 m/s."""
    features, contact = run(episodes=episodes, steps=steps, frequency=rate, **shape)
    size = features.shape[:2]
    return Gait(
        features,
        np.ones(size, bool),
        np.zeros(episodes, bool),
        DT,
        velocity=np.full(size, 4.0),
        contact=contact,
        trunk_lean=np.full(size, lean),
    )
