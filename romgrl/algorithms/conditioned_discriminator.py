"""A discriminator that sees the command: D(window, c) tells the reference at c from everything else beside c."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from romgrl.algorithms.adversarial_losses import Logits, interpolate_penalty, zero_penalty
from romgrl.algorithms.commanded_windows import CellWindows
from romgrl.algorithms.discriminator import Discriminator, feature_gap


class ConditionedDiscriminator(Discriminator):
    """As `Discriminator`, of commanded windows (B, W + K + 1), see `romgrl.algorithms.commanded_windows`.

    Fake are the student's windows with the command that it acted on and, as a share `mismatched` of them, windows of
    the reference of a cell at least `distance` m/s away from the command, or of another gait; real are those of the
    reference at the same commands, so that no command tells the streams apart. ValueError where a cell has no other.
    """

    def __init__(
        self,
        cells: CellWindows,
        *,
        mismatched: float,
        distance: float,
        standardize: bool,
        weights: Tensor | None = None,
        **settings: Any,
    ) -> None:
        columns = cells.columns
        self.cells, self.columns, self.mismatched = cells, columns, mismatched
        device = str(settings.get("device", "cpu"))
        self.far = cells.far(distance).float()
        if mismatched > 0 and not (self.far.sum(1) > 0).all():
            raise ValueError(f"no reference is {distance:g} m/s or a gait away from each of the others")
        self.standardize = standardize
        self.weights = torch.ones(columns.window, device=device) if weights is None else weights.to(device)
        half = (0.5 * (cells.speed.max() - cells.speed.min())).clamp(min=0.5)
        self.middle, self.half = cells.speed.min() + half, half
        seen = torch.zeros((len(cells.real) + len(cells.validation), columns.window + columns.gaits + 1))
        super().__init__(reference=seen, standardize=False, **settings)
        self.real, self.validation, self.learned = cells.real, cells.validation, cells.learned

    def inputs(self, windows: Tensor) -> Tensor:
        """Windows in deviations of the reference at their command, with the command: speed from -1 to 1, and gait."""
        columns = self.columns
        mean, scale = self._moments(windows)
        speed = (columns.speed(windows) - self.middle) / self.half
        gaits = windows[:, columns.window + 1 : columns.window + 1 + columns.gaits]
        return torch.cat(((windows[:, : columns.window] - mean) * scale, speed[:, None], gaits), 1)

    def _moments(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        if not self.standardize:
            return windows.new_zeros(()), self.weights
        mean, deviation = self.cells.moments(windows)
        return mean, self.weights / deviation

    def _streams(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        """Each real window stands beside the command of the fake one in its row."""
        cells = self.cells
        real, count = cells.draw_at(windows, self.generator), round(self.mismatched * len(windows))
        if count == 0:
            return real, windows
        asked = windows[:count]
        other = torch.multinomial(self.far[cells.nearest(asked)], 1, generator=self.generator).squeeze(1)
        wrong = cells.draw(other, self.generator)
        wrong[:, self.columns.commands] = asked[:, self.columns.commands]
        return real, torch.cat((wrong, windows[count:]))

    def _perturb(self, windows: Tensor) -> Tensor:
        """Commanded windows with noise on the window, in the unit that the network sees."""
        size = self.columns.window
        noise = torch.randn((len(windows), size), generator=self.generator, device=windows.device)
        disturbed = windows.clone()
        disturbed[:, :size] += self.noise * noise / self._moments(windows)[1]
        return disturbed

    def _penalty(self, real: Tensor, fake: Tensor) -> Tensor:
        """Slopes by the window, with the command of the real one, or of each stream, held fixed."""
        size = self.columns.window
        real, fake = self.inputs(real), self.inputs(fake)
        if self.penalty_on == "interpolates":
            mix = torch.rand((len(real), 1), generator=self.generator, device=real.device)
            return interpolate_penalty(self._logit_at(real[:, size:]), real[:, :size], fake[:, :size], mix)
        points = real if self.penalty_on == "reference" else torch.cat((real, fake))
        return zero_penalty(self._logit_at(points[:, size:]), points[:, :size])

    def _logit_at(self, asked: Tensor) -> Logits:
        """Logits of what the network sees of windows (B, W), with these commands (B, 1 + G)."""
        return lambda seen: self._logit(torch.cat((seen, asked), 1))

    @torch.no_grad()
    def measures(self, windows: Tensor) -> dict[str, float]:
        """As of any discriminator, of those commanded windows that have a reference."""
        return self.measures_of(windows[self.cells.taught(windows)], torch.ones_like(self.cells.gait, dtype=torch.bool))

    @torch.no_grad()
    def measures_of(self, windows: Tensor, among: Tensor) -> dict[str, float]:
        """How it tells commanded windows from the references of some cells, `among` (C,); none of either: nothing.

        The gap of the features is in standard deviations of the reference at each command.
        """
        self.network.eval()
        real, held_out = self.real[among[self.cells.real_cell]], self.validation[among[self.cells.validation_cell]]
        if len(windows) < 2 or len(real) < 2:
            return {}
        size = self.columns.window
        seen, told = self.inputs(windows), self.inputs(real)
        gap = feature_gap(seen[:, :size], told[:, :size])
        return self._measured(self._logit(seen), self._logit(told), self.logits(held_out), gap)

    @torch.no_grad()
    def accuracies_of(self, windows: Tensor, among: Tensor) -> dict[str, float]:
        """Shares of clean windows that it tells: of the references of some cells, `among` (C,), and of the student."""
        self.network.eval()
        real, fake = self.logits(self.real[among[self.cells.real_cell]]), self.logits(windows)
        threshold = self.adversarial.threshold(real, fake)
        return {
            "discriminator_accuracy_teacher": float((real > threshold).float().mean()),
            "discriminator_accuracy_student": float((fake < threshold).float().mean()),
        }
