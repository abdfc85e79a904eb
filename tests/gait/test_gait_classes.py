"""Gaits told apart by their footfall: synthetic ones of known phase and duty factor."""

from __future__ import annotations

import numpy as np
import pytest

from romgrl.gait.features import BODY_Y, Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.gait_classes import CLASSES, classified, phase_off
from tests.helpers.synthetic_gait import DT, run


def gait(*, right_phase: float = 0.5, duty: float = 0.3, **more: float) -> Gait:
    """Two episodes; the second one falls at its end."""
    features, contact = run(episodes=2, right_phase=right_phase, duty=duty, **more)
    valid = np.ones(features.shape[:2], bool)
    valid[1, -1] = False
    return Gait(features, valid, np.array([False, True]), DT, contact=contact)


@pytest.mark.parametrize(
    ("expected", "right_phase", "duty"),
    [
        ("run", 0.5, 0.3),
        ("run", 0.5, 0.45),
        ("walk", 0.5, 0.62),
        ("walk", 0.53, 0.6),
        ("hop", 0.0, 0.4),
        ("hop", 0.95, 0.4),
        ("skip", 0.3, 0.4),
        ("skip", 0.7, 0.4),  # the mirror image leads with the other foot
        ("none", 0.14, 0.3),  # between a hop and a skip
        ("none", 0.0, 0.95),  # both feet together, and hardly off the ground
    ],
)
def test_an_episode_is_of_the_gait_whose_footfall_it_fits(expected: str, right_phase: float, duty: float) -> None:
    assert classified(gait(right_phase=right_phase, duty=duty, frequency=1.5)) == [expected, "none"]


def test_without_flight_what_vaults_walks_and_what_bounces_runs() -> None:
    """Of the same contacts, with the body's height upside down: the synthetic one is highest in mid-stance."""
    vaulting = gait(duty=0.55, frequency=1.5)
    bouncing = gait(duty=0.55, frequency=1.5)
    bouncing.features[..., BODY_Y] = 1.8 - bouncing.features[..., BODY_Y]
    assert (classified(vaulting)[0], classified(bouncing)[0]) == ("walk", "run")


def test_what_stands_has_no_gait() -> None:
    still = gait()
    stands = Gait(np.full_like(still.features, 0.9), still.valid, still.fallen, DT, contact=np.ones((2, 300, 2), bool))
    assert classified(stands) == ["none", "none"]
    assert classified(Gait(still.features, still.valid, still.fallen, DT)) == ["none", "none"]  # nothing to tell by


def test_phases_are_those_of_the_check_of_references() -> None:
    assert {*CLASSES} == {*FOOTFALLS} - {"jump"}
    assert phase_off(0.98, FOOTFALLS["hop"]) == pytest.approx(0.02)
    assert phase_off(0.72, FOOTFALLS["skip"]) == pytest.approx(0.02)
    assert phase_off(0.45, FOOTFALLS["run"]) == pytest.approx(0.05)
