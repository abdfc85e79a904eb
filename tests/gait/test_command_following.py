"""Settling, overshoot, strides and switching speeds of made up speeds, contacts and duty factors."""

from __future__ import annotations

import numpy as np
import pytest

from romgrl.gait.command_following import (
    overshoot,
    running_mean,
    settling_time,
    speed_tolerance,
    strides,
    switching_speed,
)

DT = 0.1


def test_a_speed_has_settled_from_when_on_it_stays_within_its_tolerance() -> None:
    assert speed_tolerance(1.0) == 0.1
    assert speed_tolerance(4.0) == pytest.approx(0.2)
    speed = np.array([1.0, 3.9, 4.1, 4.3, 4.15, 3.85, 4.0, 4.0])  # leaves it again at 0.3 s
    assert settling_time(speed, 4.0, DT) == pytest.approx(0.4)
    assert settling_time(np.full(5, 4.0), 4.0, DT) == 0.0
    assert np.isnan(settling_time(np.append(speed, 4.3), 4.0, DT))


def test_overshoot_is_what_goes_beyond_the_target() -> None:
    speed = np.array([1.0, 3.0, 4.25, 3.9])
    assert overshoot(speed, 1.0, 4.0) == pytest.approx(0.25)
    assert overshoot(speed, 5.0, 4.0) == pytest.approx(3.0)
    assert overshoot(speed, 2.0, 2.0) == pytest.approx(2.25)
    assert overshoot(np.array([1.0, 3.9]), 1.0, 4.0) == 0.0


def test_a_mean_over_a_stride_has_none_of_its_swing() -> None:
    swing = 2.0 + 0.5 * np.sin(2 * np.pi * np.arange(60) / 20)
    np.testing.assert_allclose(running_mean(swing, 20)[10:-10], 2.0)
    np.testing.assert_allclose(running_mean(np.arange(5.0), 2), [0.0, 0.5, 1.5, 2.5, 3.5])
    np.testing.assert_allclose(running_mean(swing, 1), swing)


def test_strides_go_from_touchdown_to_touchdown_of_each_foot() -> None:
    contact = np.zeros((30, 2), bool)
    for start in (3, 13, 23):
        contact[start : start + 4, 0] = True
    for start in (8, 18):
        contact[start : start + 6, 1] = True
    assert strides(contact) == [(3, 13, 0.4), (13, 23, 0.4), (8, 18, 0.6)]
    assert strides(np.ones((9, 2), bool)) == []


def test_the_switch_is_where_the_duty_factor_crosses_half_for_good() -> None:
    asked = np.array([1.0, 1.5, 2.0, 2.5, 3.0])
    assert switching_speed(asked, np.array([0.6, 0.6, 0.55, 0.45, 0.4])) == pytest.approx(2.25)
    assert switching_speed(asked[::-1], np.array([0.4, 0.4, 0.44, 0.52, 0.6])) == pytest.approx(1.625)
    assert switching_speed(asked, np.array([0.6, 0.4, 0.6, np.nan, 0.4])) == pytest.approx(2.5)  # not at 1.25
    assert np.isnan(switching_speed(asked, np.full(5, 0.4)))
    assert np.isnan(switching_speed(asked, np.full(5, np.nan)))
