"""Windows beside the command that they were made under, and the references of a library that they are compared with.

A commanded window is a row (W + K + 1): the W entries of a window, the K = 2 + G columns of the command in force
(speed, m/s, a weight for each of G gaits, style), and the forward velocity of the step, m/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from romgrl.algorithms.discriminator import LEAST_DEVIATION

FAR_KEY = 1000.0
"""m/s between the sorted cells of two gaits: more than any speed."""
VALIDATED = 1024
"""Windows of all cells together that validate, about so many: it is done at every update."""
SPEED_SLACK = 1e-4
"""m/s by which a command may be below the slowest cell and still be taught."""


@dataclass(frozen=True)
class WindowColumns:
    """Which columns of a commanded window are what."""

    window: int
    gaits: int

    @property
    def commands(self) -> slice:
        """Of the command."""
        return slice(self.window, self.window + self.gaits + 2)

    @property
    def size(self) -> int:
        """W + K + 1."""
        return self.window + self.gaits + 3

    def speed(self, rows: Tensor) -> Tensor:
        """Speeds (...) that are asked of commanded windows (..., W + K + 1), m/s."""
        return rows[..., self.window]

    def gait(self, rows: Tensor) -> Tensor:
        """Numbers (...) of the gaits that are asked."""
        return rows[..., self.window + 1 : self.window + 1 + self.gaits].argmax(-1)


class CellWindows:
    """The windows of the references of C cells, sorted by gait and speed, and their statistics at any command.

    windows: one (N_c, W) for each cell; gait: number of its gait; speed: m/s. The last `held_out` share of each cell
    validates. `by_command`: standardised by mean and deviation of the command's cell, straight between two cells of a
    gait in speed; else by those of all cells together. ValueError where a cell has too few windows, or none is sorted.
    """

    def __init__(
        self,
        windows: Sequence[Tensor],
        gait: Sequence[int],
        speed: Sequence[float],
        *,
        gaits: int,
        held_out: float,
        by_command: bool,
        device: str = "cpu",
    ) -> None:
        self.columns = WindowColumns(windows[0].shape[1], gaits)
        self.gait = torch.tensor(gait, device=device)
        self.speed = torch.tensor(speed, dtype=torch.float32, device=device)
        self._order = self.gait * FAR_KEY + self.speed
        if len(gait) > 1 and not (self._order.diff() > 0).all():
            raise ValueError("cells must be sorted by gait and speed")
        cells = torch.arange(len(gait), device=device)
        self._first = torch.searchsorted(self.gait, torch.arange(gaits, device=device))
        self._last = torch.searchsorted(self.gait, torch.arange(gaits, device=device), right=True) - 1
        if (self._last < self._first).any():
            raise ValueError("each gait must have a cell")
        splits = [max(1, round(len(each) * (1 - held_out))) for each in windows]
        if any(split >= len(each) for split, each in zip(splits, windows, strict=True)):
            raise ValueError(f"held_out {held_out} leaves no window of a cell to validate")
        beside = [self._beside(each.to(device), cell) for each, cell in zip(windows, cells, strict=True)]
        rows = list(zip(beside, splits, strict=True))
        self.real = torch.cat([each[:split] for each, split in rows])
        step = max(1, sum(len(each) - split for each, split in rows) // VALIDATED)
        self.validation = torch.cat([each[split::step] for each, split in rows])
        self.learned = torch.cat([each[: min(split, len(each) - split) : step] for each, split in rows])
        self._count = torch.tensor(splits, device=device)
        self.real_cell = cells.repeat_interleave(self._count)
        held = torch.tensor([len(each[split::step]) for each, split in rows], device=device)
        self.validation_cell = cells.repeat_interleave(held)
        self._start = self._count.cumsum(0) - self._count
        together = torch.cat(list(windows))
        each = [part if by_command else together for part in windows]
        self.mean = torch.stack([part.mean(0) for part in each]).to(device)
        self.deviation = torch.stack([part.std(0).clamp(min=LEAST_DEVIATION) for part in each]).to(device)

    def _beside(self, windows: Tensor, cell: Tensor) -> Tensor:
        """Commanded windows of a cell: its own command, and no velocity."""
        columns = self.columns
        rows = windows.new_zeros((len(windows), columns.size))
        rows[:, : columns.window] = windows
        rows[:, columns.commands] = self.command(cell.expand(len(windows)))
        return rows

    def command(self, cell: Tensor) -> Tensor:
        """Commands (B, K) of cells (B,), with style 1."""
        weights = torch.nn.functional.one_hot(self.gait[cell], self.columns.gaits)
        return torch.cat((self.speed[cell, None], weights, torch.ones_like(weights[:, :1])), 1)

    def taught(self, rows: Tensor) -> Tensor:
        """Which commanded windows (...) have a reference: those that are not to stand, unless that is taught."""
        slowest = self.speed[self._first]
        return self.columns.speed(rows) >= slowest[self.columns.gait(rows)] - SPEED_SLACK

    def between(self, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The cells below and above the command of commanded windows (B,), and the share of the way up, in [0, 1]."""
        gait, speed = self.columns.gait(rows), self.columns.speed(rows)
        place = torch.searchsorted(self._order, gait * FAR_KEY + speed)
        low = torch.clamp(place - 1, self._first[gait], self._last[gait])
        high = torch.clamp(place, self._first[gait], self._last[gait])
        gap = self.speed[high] - self.speed[low]
        share = torch.where(high > low, (speed - self.speed[low]) / gap.clamp(min=1e-9), 0.0)
        return low, high, share.clamp(0.0, 1.0)

    def nearest(self, rows: Tensor) -> Tensor:
        """The cell (B,) whose command is nearest to that of commanded windows."""
        low, high, share = self.between(rows)
        return torch.where(share < 0.5, low, high)

    def moments(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and deviation (B, W) of the reference at the commands of commanded windows."""
        low, high, share = self.between(rows)
        mean, deviation = (torch.lerp(part[low], part[high], share[:, None]) for part in (self.mean, self.deviation))
        return mean, deviation

    def draw(self, cell: Tensor, generator: torch.Generator) -> Tensor:
        """Commanded windows (B, W + K + 1) to learn from, each of its cell."""
        place = torch.rand(len(cell), generator=generator, device=cell.device) * self._count[cell]
        return self.real[self._start[cell] + place.long().minimum(self._count[cell] - 1)]

    def draw_at(self, rows: Tensor, generator: torch.Generator) -> Tensor:
        """Windows of the reference at the commands of commanded windows (B, W + K + 1), beside these commands.

        Each is of the cell below or above, as likely as it is near, in whose deviations from the mean it is what it is
        at the command: D would learn which speeds the cells have if these stood beside the real ones alone.
        """
        low, high, share = self.between(rows)
        chance = torch.rand(len(rows), generator=generator, device=rows.device)
        cell = torch.where(chance < share, high, low)
        drawn, (mean, deviation), size = self.draw(cell, generator), self.moments(rows), self.columns.window
        drawn[:, :size] = torch.addcmul(mean, drawn[:, :size] - self.mean[cell], deviation / self.deviation[cell])
        drawn[:, self.columns.commands] = rows[:, self.columns.commands]
        return drawn

    def far(self, distance: float) -> Tensor:
        """Which cells (C, C) are far from each: at least `distance` m/s apart, or of another gait."""
        apart = (self.speed[:, None] - self.speed).abs() >= distance - SPEED_SLACK
        return apart | (self.gait[:, None] != self.gait)
