"""What made up tables of an evaluation over a grid come to: numbers of the bars, specialists, costs."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from romgrl.report.specialists import Specialist
from romgrl.stages.conditioned.grid_summary import (
    bar,
    cell_numbers,
    cheapest_speeds,
    diagonal_percent,
    held_out_ratio,
    least_spearman,
    specialist_numbers,
    with_specialists,
)

HELD = {"speed_held": True, "obeyed_gait": 1.0, "episodes": 8}


def test_numbers_of_the_bars_are_those_of_made_up_tables() -> None:
    rows = pd.DataFrame(
        {
            "walker": "student",
            "gait": "run",
            "speed_m_per_s": [2.0, 2.5, 3.0, 3.5],
            "taught": [True, False, True, False],
            "error_over_variance": [0.1, 0.3, 0.3, 0.33],
            "stride_frequency_hz": [1.2, 1.3, 1.25, np.nan],
            "cost_of_transport": [0.5, 0.4, 0.45, np.nan],
            "error_over_specialist": np.nan,
            "falls": 0,
        }
    )
    assert held_out_ratio(rows) == pytest.approx(0.3 / 0.2)
    assert np.isnan(held_out_ratio(rows[rows.taught]))
    fallen = rows.assign(error_over_variance=[0.1, np.nan, 0.3, 0.33])  # all episodes of one that is not taught
    assert held_out_ratio(fallen) == np.inf
    assert held_out_ratio(rows.assign(error_over_variance=[np.nan, 0.3, 0.3, 0.33])) == np.inf  # of one next to it
    assert least_spearman(rows, "stride_frequency_hz") == pytest.approx(0.5)
    assert least_spearman(rows.assign(stride_frequency_hz=1.2), "stride_frequency_hz") == 0.0
    assert cheapest_speeds(rows) == {"run": {"least": 0.4, "at_m_per_s": 2.5, "is_u": True}}
    assert not cheapest_speeds(rows.assign(falls=[0, 0, 1, 0]))["run"]["is_u"]  # a fall is no end of a U
    beside = with_specialists(rows, [Specialist("run", 3.0, 0.2, 0, 16), Specialist("walk", 2.0, 0.1, 0, 16)])
    assert beside.error_over_specialist.isna().tolist() == [True, True, False, True]
    assert beside.error_over_specialist[2] == pytest.approx(1.5)
    lost = with_specialists(fallen, [Specialist("run", speed, 0.2, 0, 16) for speed in (2.5, 3.0)])
    assert cell_numbers(lost.assign(**HELD))["error_over_specialist"] == np.inf  # not what is left of the cells
    assert diagonal_percent(np.array([[0.1, 0.2], [0.1, 0.2]])) == 50.0
    assert diagonal_percent(np.array([[0.1, 0.2], [np.nan, np.nan]])) == 50.0
    reached = [bar("most_falls_percent", {"student": {"most_falls_percent": value}})["reached"] for value in (1.0, 2.0)]
    assert reached == [True, False]
    assert bar("most_falls_percent", {"student": {}})["reached"] is None


def test_a_specialist_without_an_error_is_written_as_one() -> None:
    """Strict JSON has no nan: the evaluation would end with nothing after all its episodes."""
    (entry,) = specialist_numbers([Specialist("run", 3.0, float("nan"), 16, 16)])
    assert json.loads(json.dumps(entry, allow_nan=False)) == {
        "gait": "run",
        "speed": 3.0,
        "error": None,
        "falls": 16,
        "episodes": 16,
    }
