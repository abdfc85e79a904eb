"""Taking the state of learners apart into named tensors and numbers, and putting it back, bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from romgrl.errors import ArtifactError


def put(name: str, target: Tensor, value: Tensor) -> None:
    """Overwrite a tensor in place; ArtifactError if the value has another shape or dtype."""
    if (target.shape, target.dtype) != (value.shape, value.dtype):
        needed, found = (f"{tuple(tensor.shape)} {tensor.dtype}" for tensor in (target, value))
        raise ArtifactError(f"checkpoint: {name} is {found}, needed is {needed}")
    with torch.no_grad():
        target.copy_(value)


def put_all(targets: Mapping[str, Tensor], values: Mapping[str, Tensor]) -> None:
    """Overwrite several tensors in place; ArtifactError unless the names are the same, too."""
    if targets.keys() != values.keys():
        raise ArtifactError(f"checkpoint: has {sorted(values)}, needed is {sorted(targets)}")
    for name, target in targets.items():
        put(name, target, values[name])


def optimizer_state(optimizer: torch.optim.Optimizer) -> dict[str, Any]:
    """Moments and step counts of all parameters; nothing before the first step."""
    return {str(index): dict(entry) for index, entry in optimizer.state_dict()["state"].items()}


def restore_optimizer(optimizer: torch.optim.Optimizer, state: Mapping[str, Mapping[str, Tensor]]) -> None:
    """Put back what `optimizer_state` returned; learning rates stay as they are."""
    document = optimizer.state_dict()
    document["state"] = {int(index): dict(entry) for index, entry in state.items()}
    optimizer.load_state_dict(document)
