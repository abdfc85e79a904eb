"""ROM-GRL of a student that follows commands: relabelled transitions, and windows of the student gait by gait."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from romgrl.algorithms.commanded_windows import SPEED_SLACK, CellWindows, WindowColumns
from romgrl.algorithms.relabelling import Relabelling
from romgrl.algorithms.replay_buffer import Batch, ReplayBuffer, mirror_half
from romgrl.algorithms.rom_grl import RomGrl

CANDIDATES = 8
"""Windows drawn for each that the discriminator gets: what is asked of all that are stored takes long to count."""


class CommandedBuffer(ReplayBuffer):
    """A replay buffer of commanded windows, see `romgrl.algorithms.commanded_windows`.

    What it gives the discriminator leaves out commands below the slowest speed of their gait, `slowest` (G,), m/s: to
    stand, of which there is no reference. `stratify`: as many of each gait.
    """

    def __init__(self, *, columns: WindowColumns, slowest: Tensor, stratify: bool, **settings: Any) -> None:
        super().__init__(window_size=columns.size, **settings)
        self.columns, self.slowest, self.stratify = columns, slowest, stratify

    def sample_windows(self, size: int, recent: int | None = None) -> Tensor:
        """Draw commanded windows (size, W + K + 1) from the last `recent` transitions (None: all)."""
        rows = min(self.added, self.rows)
        if recent is not None:
            rows = min(rows, max(1, recent // self.num_envs))
        spread = CANDIDATES * size
        place = torch.randint(rows * self.num_envs, (spread,), generator=self.generator, device=self.windows.device)
        place = (place + (self.added - rows) % self.rows * self.num_envs) % (self.rows * self.num_envs)
        asked = self.windows.flatten(0, 1)[:, self.columns.commands].index_select(0, place)
        gait = asked[:, 1:-1].argmax(1)
        weight = (asked[:, 0] >= self.slowest[gait] - SPEED_SLACK).float()
        if self.stratify:
            weight = weight / torch.bincount(gait, weight, self.columns.gaits).clamp(min=1.0)[gait]
        weight += torch.finfo(weight.dtype).tiny  # where all stand, any of them
        place = place[torch.multinomial(weight, size, replacement=True, generator=self.generator)]
        windows = self.windows.flatten(0, 1).index_select(0, place)
        mirror_half(windows, self.mirrors[2])
        return windows


@dataclass(kw_only=True)
class ConditionedRomGrl(RomGrl):
    """As `RomGrl`, of transitions whose command may be exchanged when they are drawn.

    The weight of the task is `etas` (C,) at the C cells that are taught, and straight in speed between them; `eta` is
    their mean. A command without a reference, to stand, is paid for its speed alone.
    """

    relabelling: Relabelling
    cells: CellWindows | None
    """None without a discriminator."""
    etas: Tensor = field(init=False)

    def __post_init__(self) -> None:
        """Begin with the same weight at all cells."""
        count = 1 if self.cells is None else len(self.cells.gait)
        self.etas = torch.full((count,), self.eta, device=self.buffer.windows.device)

    def draw(self, size: int) -> Batch:
        """So many transitions, a share of them with other commands."""
        batch = super().draw(size)
        self.relabelling.apply_(batch)
        return batch

    def task_weight(self, batch: Batch) -> Tensor | float:
        """Eta of the steps of a batch (B, n); 1 of those that are to stand."""
        if self.cells is None:
            return self.eta
        low, high, share = self.cells.between(batch.windows)
        eta = torch.lerp(self.etas[low], self.etas[high], share)
        return torch.where(self.cells.taught(batch.windows), eta, 1.0)

    def weigh_task(self, eta: float) -> None:
        """Give the task this weight at all cells from now on."""
        self.eta = eta
        self.etas.fill_(eta)

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs, but the rows of the buffer."""
        return super().state() | {"relabelling": self.relabelling.state(), "etas": self.etas}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        super().restore(state)
        self.relabelling.restore(state["relabelling"])
        self.etas.copy_(state["etas"])
