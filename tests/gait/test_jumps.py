"""How high jumps are: parabolas of a known top, sampled as a gait is."""

from __future__ import annotations

import numpy as np
import pytest

from romgrl.gait.features import Gait
from romgrl.gait.jumps import describe_jumps, jump_apexes
from romgrl.gait.metrics import GRAVITY

DT, STANDING = 1 / 30, 0.94


def jumps(tops: list[float], stance: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Body heights (1, T) m and contact (1, T, 2) of jumps to some heights over standing, with stances around them."""
    heights, contact = [np.full(stance, STANDING - 0.1)], [np.ones(stance, bool)]
    for top in tops:
        half = np.sqrt(2 * top / GRAVITY)
        time = np.arange(0.01, 2 * half, DT)
        heights += [STANDING + top - 0.5 * GRAVITY * (time - half) ** 2, np.full(stance, STANDING - 0.1)]
        contact += [np.zeros(len(time), bool), np.ones(stance, bool)]
    return np.concatenate(heights)[None], np.concatenate(contact)[None, :, None].repeat(2, axis=2)


def gait(heights: np.ndarray, contact: np.ndarray, valid: np.ndarray | None = None) -> Gait:
    features = np.zeros((*heights.shape, 5))
    features[..., 0] = heights
    valid = np.ones(heights.shape, bool) if valid is None else valid
    return Gait(features, valid, np.zeros(len(heights), bool), DT, contact=contact)


def test_the_top_is_known_to_a_few_millimetres() -> None:
    tops = [0.1, 0.25, 0.5]
    heights, contact = jumps(tops)
    found = jump_apexes(gait(heights, contact).features, contact, np.ones(heights.shape, bool)) - STANDING
    assert found == pytest.approx(tops, abs=GRAVITY * DT**2 / 8)
    assert (found <= np.array(tops) + 1e-12).all()


def test_jumps_beside_what_was_asked() -> None:
    told = describe_jumps(gait(*jumps([0.2, 0.4])), asked=0.3, standing=STANDING)
    assert told["jumps"] == 2
    assert told["jump_apex_m"] == pytest.approx(0.3, abs=0.002)
    assert told["jump_apex_error_m"] == pytest.approx(0.1, abs=0.002)


def test_a_flight_that_is_cut_is_no_jump() -> None:
    heights, contact = jumps([0.3, 0.2])
    cut = np.ones(heights.shape, bool)
    cut[:, :16] = False  # within the first flight
    assert describe_jumps(gait(heights, contact, cut), asked=0.2, standing=STANDING)["jumps"] == 1
    contact[..., 0] = True
    told = describe_jumps(gait(heights, contact), asked=0.2, standing=STANDING)
    assert told["jumps"] == 0
    assert np.isnan(told["jump_apex_error_m"])
