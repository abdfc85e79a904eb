"""The learners' networks once more, by operations that torch differentiates itself."""

from __future__ import annotations

from torch import Tensor
from torch.nn import functional

from romgrl.algorithms.networks.stacked_mlp import StackedMLP


def forward_by_autograd(network: StackedMLP, activation: str, flat: Tensor, inputs: Tensor) -> Tensor:
    """The network's outputs (S, B, O) by torch's own operations, differentiable by `flat` and inputs (B, I)."""
    x = inputs.expand(network.stack, -1, -1)
    last = len(network.weights) - 1
    for layer, (weight, bias) in enumerate(zip(*network._views(flat), strict=True)):
        x = x @ weight + bias
        if layer < last:
            x = functional.layer_norm(x, x.shape[-1:]) if network.layer_norm else x
            x = getattr(functional, activation)(x)
    return x
