"""The weight of the task of a student that follows commands: of each cell, steered by its checks."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from romgrl.algorithms.conditioned_rom_grl import ConditionedRomGrl
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages.conditioned.cells import CommandCells, read_command_cells
from romgrl.stages.conditioned.grid_check import GridChecks, grid_summary
from romgrl.stages.student import conditioned_training
from tests.conftest import Composer
from tests.helpers.command_cells import RUN, WALK, asked, cells
from tests.helpers.commanded import commanded, small_library

RIGHT = {"falls": 0.0, "cadence_error_percent": 0.0, "error_over_variance": 0.1}


def learner(eta: float) -> ConditionedRomGrl:
    """Of four cells: runs at 2, 3 and 4 m/s and a walk at 1 m/s; nothing in it learns."""
    nothing: Any = SimpleNamespace(windows=torch.zeros(1))
    return ConditionedRomGrl(
        sac=nothing, discriminator=None, buffer=nothing, normalizer=nothing, eta=eta, batch_size=1,
        discriminator_interval=1, discriminator_batch=1, discriminator_recent=None, relabelling=nothing, cells=cells(),
    )  # fmt: skip


def test_the_task_weighs_what_its_cells_say_and_all_of_it_to_stand() -> None:
    made = learner(0.3)
    batch: Any = SimpleNamespace(windows=torch.stack((asked(RUN, 2.0, 2.5, 0.0), asked(WALK, 1.0, 1.5, 0.0))))
    torch.testing.assert_close(made.task_weight(batch), torch.tensor([[0.3, 0.3, 1.0], [0.3, 0.3, 1.0]]))
    made.etas.copy_(torch.tensor([0.3, 0.5, 0.7, 0.6]))
    torch.testing.assert_close(made.task_weight(batch), torch.tensor([[0.3, 0.4, 1.0], [0.6, 0.6, 1.0]]))


def test_a_check_counts_cells_whose_speed_is_held_without_a_fall() -> None:
    row = RIGHT | {"steady_speed_m_per_s": 2.05, "speed_error_m_per_s": 0.05}
    off, fell = row | {"speed_error_m_per_s": 0.2, "steady_speed_m_per_s": 2.2}, row | {"falls": 1.0}
    told = "speed held without a fall in 1 of 3 cells, 1 of 12 episodes fall, error over variance 0.10 in the middle"
    assert grid_summary([row, off, fell]) == told


def test_each_cell_steers_its_own_weight(compose_config: Composer, tmp_path: Path) -> None:
    """Up where it is too slow, down where it strides otherwise, as it is where it falls; never below the first one."""
    config = commanded(compose_config, "eta=0.3")
    taught: CommandCells = read_command_cells(small_library(tmp_path / "library"), config, span=4)
    assert taught.speed.tolist() == [2.0, 3.0, 4.0, 1.0, 2.0]
    made = learner(0.4)
    made.etas = torch.full((5,), 0.4)
    checks = GridChecks(0, config, None, taught, True, torch.zeros(1), None, tmp_path, SilentLog())
    rows = [RIGHT | {"steady_speed_m_per_s": float(speed)} for speed in taught.speed]
    rows[1] |= {"steady_speed_m_per_s": 2.7}
    rows[2] |= {"cadence_error_percent": 20.0}
    rows[3] |= {"steady_speed_m_per_s": 0.7, "falls": 4.0}
    checks.adapt(rows, made)
    assert made.etas.tolist() == pytest.approx([0.4, 0.46, 0.4 / 1.1, 0.4, 0.4])
    assert made.eta == pytest.approx(float(made.etas.mean()))
    for _ in range(5):
        checks.adapt(rows, made)
    assert made.etas.tolist() == pytest.approx([0.4, 0.7, 0.3, 0.4, 0.4])


def test_the_weight_of_the_speed_moves_over_the_middle_half(compose_config: Composer, tmp_path: Path) -> None:
    config = commanded(compose_config, "eta=0.5", "student.final_eta=0.3")
    with_library = conditioned_training(
        config, small_library(tmp_path / "library"), tmp_path, SilentLog(), None, threads=1
    )
    follows, made = with_library.follows, with_library.learner
    assert follows is not None
    assert isinstance(made, ConditionedRomGrl)
    weights = []
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        follows.review(0, share)
        assert made.etas.tolist() == pytest.approx([made.eta] * 5)
        weights.append(made.eta)
    assert weights == pytest.approx([0.5, 0.5, 0.4, 0.3, 0.3])
