"""A teacher of a range is told another speed or apex where it comes to more or less than it is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import BODY_Y, Gait
from romgrl.gait.footfall import Footfall
from romgrl.rom.parameters import standing_height
from romgrl.stages.rollouts import teacher
from romgrl.stages.rollouts.teacher import missed, order_of_try, roll_out_as_asked
from romgrl.stages.wiring.rom import rom_parameters
from tests.conftest import Composer
from tests.helpers.synthetic_gait import DT, run

PLACE = Path("teacher")


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Speeds that a teacher was told which holds 0.95 of each, and falls above 4.9 m/s."""
    speeds: list[float] = []

    def roll_out(directory: Path, config: Config) -> Gait:
        speeds.append(config.teacher.speed)
        features, contact = run(episodes=2)
        valid, velocity = np.ones(contact.shape[:2], bool), np.full(contact.shape[:2], 0.95 * config.teacher.speed)
        return Gait(features, valid, np.full(2, config.teacher.speed > 4.9), DT, velocity=velocity, contact=contact)

    monkeypatch.setattr(teacher, "roll_out_teacher", roll_out)
    return speeds


def test_a_slow_teacher_is_told_the_difference(told: list[float], compose_config: Composer) -> None:
    gait, at = roll_out_as_asked(PLACE, compose_config("teacher=variable_running", "speed=4"))
    assert told == pytest.approx([4.0, 4.2])
    assert (at.teacher.speed, at.speed) == pytest.approx((4.2, 4.0))
    assert gait.velocity is not None
    assert gait.velocity.mean() == pytest.approx(4.0, abs=0.04)


def test_a_teacher_that_jumps_too_low_is_told_the_difference(
    monkeypatch: pytest.MonkeyPatch, compose_config: Composer
) -> None:
    """One that comes to 0.9 of each apex. Its body is at standing height on the ground, and at the apex in the air."""
    config, tries = compose_config("teacher=jumping", "teacher.apex=0.3"), []
    standing = standing_height(rom_parameters(config))

    def roll_out(directory: Path, at: Config) -> Gait:
        tries.append(at.teacher.apex)
        features, contact = run(episodes=2, right_phase=0.0, duty=0.4)
        features[..., BODY_Y] = standing + 0.9 * at.teacher.apex * ~contact.any(axis=-1)
        still, valid = np.zeros(contact.shape[:2]), np.ones(contact.shape[:2], bool)
        return Gait(features, valid, np.zeros(2, bool), DT, velocity=still, contact=contact)

    monkeypatch.setattr(teacher, "roll_out_teacher", roll_out)
    told = roll_out_as_asked(PLACE, config)
    assert tries == pytest.approx([0.3, 0.33])
    assert told.words(config) == ", told 0.33 m for an apex of 0.3 m"
    assert (told.words(told.config), missed(told.gait, config)) == ("", pytest.approx(-0.003, abs=1e-6))


def test_what_is_fit_comes_before_what_is_nearer(
    told: list[float], monkeypatch: pytest.MonkeyPatch, compose_config: Composer
) -> None:
    """A teacher that is slow and fit; told the difference, it is refused as a reference."""

    def check(gait: Gait, footfall: Footfall) -> None:
        assert gait.velocity is not None
        if gait.velocity.mean() > 3.9:
            raise ArtifactError("the reference drifts")

    config = compose_config("teacher=variable_running", "speed=4")
    monkeypatch.setattr(teacher, "check_reference", check)
    found = roll_out_as_asked(PLACE, config)
    assert (found.config.teacher.speed, told) == (4.0, pytest.approx([4.0, 4.2]))
    assert order_of_try(found.gait, config) == (0, False, pytest.approx(0.2))


@pytest.mark.parametrize(
    ("settings", "tries", "kept"),
    [
        (("teacher=variable_running", "speed=4.8"), [4.8, 5.0], 4.8),  # it falls there; 5 is the end of its range
        (("teacher=variable_running", "speed=4.6"), [4.6, 4.83], 4.83),
        (("speed=4",), [4.0], 4.0),  # a teacher of one speed knows no other
    ],
)
def test_it_is_told_what_lies_in_its_range_and_keeps_what_stands(
    told: list[float], compose_config: Composer, settings: tuple[str, ...], tries: list[float], kept: float
) -> None:
    assert roll_out_as_asked(PLACE, compose_config(*settings)).config.teacher.speed == pytest.approx(kept)
    assert told == pytest.approx(tries)
