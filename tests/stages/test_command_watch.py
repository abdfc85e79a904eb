"""The bands of speeds that the discriminator of a student that follows commands is watched in."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from romgrl.stages.conditioned.command_watch import speed_bands
from tests.helpers.command_cells import RUN, WALK, cells


def test_every_command_lies_in_one_band_the_fastest_one_too() -> None:
    """Where the gait changes, the end of its range is asked for often: it is nearest to the speed before."""
    bands = speed_bands(np.array([[2.0, 4.0], [0.5, 2.25], [3.0, 3.0]]))
    assert [(band.gait, band.low, band.high) for band in bands] == [
        *[(0, 2.0, 3.0), (0, 3.0, 4.0)],
        *[(1, 0.0, 1.0), (1, 1.0, 2.0), (1, 2.0, 3.0)],
        (2, 3.0, 4.0),
    ]
    gait = torch.tensor([0, 0, 0, 0, 1, 1, 1, 2])
    speed = torch.tensor([2.0, 2.99, 3.0, 4.0, 0.5, 1.0, 2.25, 3.0])
    inside = torch.stack([band.has(gait, speed) for band in bands])
    assert inside.sum(dim=0).tolist() == [1] * 8
    assert inside.int().argmax(dim=0).tolist() == [0, 0, 1, 1, 2, 3, 4, 5]


def test_cells_at_both_ends_of_a_band_count() -> None:
    bands = speed_bands(np.array([[2.0, 4.0], [1.0, 1.0]]))
    assert [band.among(cells()).tolist() for band in bands] == [
        [True, True, False, False],
        [False, True, True, False],
        [False, False, False, True],
    ]
    assert [band.gait for band in bands] == [RUN, RUN, WALK]


def test_the_weight_of_the_task_is_that_of_the_cells_of_a_band() -> None:
    """Which the checks steer one by one: the mean of all says nothing of a band."""
    learner: Any = SimpleNamespace(cells=cells(), etas=torch.tensor([0.2, 0.4, 0.6, 0.9]), eta=0.525)
    bands = speed_bands(np.array([[2.0, 4.0], [1.0, 1.0], [1.0, 1.0]]))
    assert [band.task_weight(learner) for band in bands] == pytest.approx([0.3, 0.5, 0.9, 0.525])
