"""The gait figure shows each walker's number over the human band."""

from __future__ import annotations

import math

import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from romgrl.gait import human_bands
from romgrl.report import human_band_figure, markdown_report

GAITS = pd.DataFrame(
    {
        "walker": ["teacher", "student", "baseline"],
        "steady_speed_m_per_s": [4.0, 3.9, 4.1],
        "stride_frequency_hz": [1.5, 1.6, math.nan],
        "duty_factor": [0.3, 0.31, 0.45],
        "pelvis_excursion_m": [0.086, 0.08, 0.03],
        "positive_power_w_per_kg": [math.nan, 11.0, 16.0],
    }
)


def shaded(figure: Figure) -> list[tuple[float, float]]:
    """Lower and upper end of the shaded band of every panel that has one."""
    patches = [patch for axes in figure.axes for patch in axes.patches if isinstance(patch, Rectangle)]
    return [(patch.get_y(), patch.get_y() + patch.get_height()) for patch in patches]


def test_every_panel_shades_the_band_of_its_measure() -> None:
    figure = human_band_figure.gait_bands(GAITS, 4.0)
    known = human_bands.bands(4.0)
    expected = [known[measure] for measure in human_band_figure.PANELS]
    assert shaded(figure) == [(pytest.approx(band.low), pytest.approx(band.high)) for band in expected]


def test_every_walker_has_its_dot() -> None:
    figure = human_band_figure.gait_bands(GAITS, 4.0)
    frequency, length, duty, excursion, power = ([line.get_ydata()[0] for line in axes.lines] for axes in figure.axes)
    assert frequency[:2] == [1.5, 1.6]
    assert math.isnan(frequency[2])
    assert length[:2] == pytest.approx([4.0 / 1.5, 3.9 / 1.6])
    assert duty == [0.3, 0.31, 0.45]
    assert excursion == [0.086, 0.08, 0.03]
    assert math.isnan(power[0])
    assert power[1:] == [11.0, 16.0]


def test_what_an_older_table_does_not_have_has_no_dot() -> None:
    axes = human_band_figure.gait_bands(GAITS.drop(columns="positive_power_w_per_kg"), 4.0).axes[-1]
    assert all(math.isnan(line.get_ydata()[0]) for line in axes.lines)


def test_where_nothing_is_known_nothing_is_shaded_and_it_is_said() -> None:
    figure = human_band_figure.gait_bands(GAITS, 5.0)
    assert shaded(figure) == []
    assert "no human data" in figure.get_suptitle()
    assert "No published numbers" in markdown_report.humans(5.0)


def test_the_report_lists_the_bands_with_their_sources() -> None:
    text = markdown_report.humans(1.0)
    assert "| stride frequency [Hz] | 0.75 | 1.05 |" in text
    assert "Nilsson & Thorstensson 1987" in text
