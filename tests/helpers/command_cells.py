"""Windows of four made up cells, runs at 2, 3 and 4 m/s and a walk at 1 m/s, and of a student that is asked for any."""

from __future__ import annotations

from typing import Any

import torch

from romgrl.algorithms.commanded_windows import CellWindows, WindowColumns

RUN, WALK = 0, 1
GAIT, SPEED = [RUN, RUN, RUN, WALK], [2.0, 3.0, 4.0, 1.0]
W, COLUMNS = 3, WindowColumns(3, 2)


def cells(**changes: Any) -> CellWindows:
    """Cell n has windows about 10 n, with a deviation of n + 1."""
    generator = torch.Generator().manual_seed(0)
    windows = [10.0 * n + (n + 1) * torch.randn((400, W), generator=generator) for n in range(4)]
    return CellWindows(windows, GAIT, SPEED, gaits=2, **{"held_out": 0.1, "by_command": True} | changes)


def asked(gait: int, *speeds: float) -> torch.Tensor:
    """Commanded windows of zeros."""
    rows = torch.zeros((len(speeds), COLUMNS.size))
    rows[:, W], rows[:, W + 1 + gait], rows[:, -2] = torch.tensor(speeds), 1.0, 1.0
    return rows
