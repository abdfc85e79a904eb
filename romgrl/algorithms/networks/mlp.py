"""Multilayer perceptrons and their initialisation."""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch import nn

ACTIVATIONS: dict[str, type[nn.Module]] = {
    "tanh": nn.Tanh,
    "relu": nn.ReLU,
    "elu": nn.ELU,
    "leaky_relu": nn.LeakyReLU,
}


def mlp(
    input_size: int, hidden_sizes: Sequence[int], output_size: int, activation: str, layer_norm: bool = False
) -> nn.Sequential:
    """Linear layers, (N, input) -> (N, output), with `activation` between them, after layer normalisation if wished.

    Raises ValueError for an activation that is not in ACTIVATIONS.
    """
    if activation not in ACTIVATIONS:
        raise ValueError(f"activation must be one of {', '.join(ACTIVATIONS)}, not {activation!r}")
    layers: list[nn.Module] = []
    size = input_size
    for hidden_size in hidden_sizes:
        layers.append(nn.Linear(size, hidden_size))
        if layer_norm:
            layers.append(nn.LayerNorm(hidden_size))
        layers.append(ACTIVATIONS[activation]())
        size = hidden_size
    layers.append(nn.Linear(size, output_size))
    return nn.Sequential(*layers)


def initialise_orthogonal(network: nn.Sequential, output_gain: float, hidden_gain: float = math.sqrt(2.0)) -> None:
    """Orthogonal weights and zero biases, the usual start of PPO: a small `output_gain` gives small first outputs."""
    linear_layers = [layer for layer in network if isinstance(layer, nn.Linear)]
    for layer in linear_layers:
        gain = output_gain if layer is linear_layers[-1] else hidden_gain
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
