"""Running mean and standard deviation, of observations or returns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor


class RunningNormalizer:
    """Standardises observations with the mean and variance of all that it has seen (Chan et al. 1979).

    `limit`: beyond so many deviations they are cut off. With `enabled` false it leaves observations as they are.
    """

    def __init__(self, size: int, *, enabled: bool = True, limit: float | None = None, device: str = "cpu") -> None:
        self.enabled, self.limit = enabled, limit
        self.count = 0
        self.mean = torch.zeros(size, dtype=torch.float64, device=device)
        self.square = torch.zeros(size, dtype=torch.float64, device=device)
        self._shift = torch.zeros(size, device=device)
        self._scale = torch.ones(size, device=device)

    def update(self, observation: Tensor) -> None:
        """Take in a batch (N, size)."""
        if not self.enabled:
            return
        values = observation.double()
        added = len(values)
        delta = values.mean(0) - self.mean
        total = self.count + added
        self.square += (values - values.mean(0)).square().sum(0) + delta.square() * (self.count * added / total)
        self.mean += delta * (added / total)
        self.count = total
        deviation = (self.square / total).sqrt().clamp(min=1e-2)
        self._shift.copy_(self.mean)
        self._scale.copy_(1 / deviation)

    def apply_(self, observation: Tensor) -> Tensor:
        """Standardise in place (B, size)."""
        if not self.enabled:
            return observation
        observation.sub_(self._shift).mul_(self._scale)
        return observation if self.limit is None else observation.clamp_(-self.limit, self.limit)

    def undo(self, standardised: Tensor) -> Tensor:
        """What `apply_` would make these of (B, size), within the limit."""
        if not self.enabled:
            return standardised
        bounded = standardised if self.limit is None else standardised.clamp(-self.limit, self.limit)
        return bounded / self._scale + self._shift

    def state(self) -> dict[str, Tensor | int]:
        """Everything that `restore` needs."""
        return {"count": self.count, **self._tensors()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.count = state["count"]
        for name, tensor in self._tensors().items():
            tensor.copy_(state[name])

    def _tensors(self) -> dict[str, Tensor]:
        return {"mean": self.mean, "square": self.square, "shift": self._shift, "scale": self._scale}

    def use(self, mean: Tensor, scale: Tensor) -> None:
        """Standardise with these from now on, until the next update."""
        self._shift.copy_(mean)
        self._scale.copy_(scale)

    def mean_and_scale(self) -> tuple[Tensor, Tensor]:
        """Shift and scale as they are now: (observation - mean) * scale."""
        return self._shift.clone(), self._scale.clone()
