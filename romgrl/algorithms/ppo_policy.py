"""The teacher's policy without exploration, and its file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from romgrl.algorithms.networks.running_normalizer import RunningNormalizer
from romgrl.algorithms.networks.stacked_mlp import ACTIVATIONS, StackedMLP
from romgrl.algorithms.policy_file import (
    COLUMN_NAMES,
    NETWORK,
    check_tensors,
    layer_sizes,
    read_policy,
    require,
    require_names,
)
from romgrl.artifacts import save_tensors

LIMIT = 5.0
"""Normalised observations and returns are cut off there, as by Sample Factory."""
OBSERVATION_MOMENTS = ("observation_mean", "observation_scale")
"""Tensors of a policy's file that hold how its observations are normalised, where they are."""


class Learner(Protocol):
    """What a file needs of PPO."""

    policy: StackedMLP
    log_std: Tensor
    observations: RunningNormalizer
    spec: dict[str, Any]


class PPOPolicy:
    """Mean of the Gaussian policy, clipped: (N, O) float32 -> (N, A) float32 in [-1, 1].

    `moments`: mean and scale (O,) of observations; what the network sees is (observation - mean) * scale within LIMIT.
    """

    def __init__(self, network: StackedMLP, moments: tuple[Tensor, Tensor] | None = None) -> None:
        self.network, self.moments = network, moments

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = torch.from_numpy(observation)
        if self.moments is not None:
            mean, scale = self.moments
            seen = (seen - mean).mul_(scale).clamp_(-LIMIT, LIMIT)
        mean_action = self.network.forward(seen, self.network.tape(len(observation)))[0]
        action: NDArray[np.float32] = mean_action.clamp_(-1.0, 1.0).numpy()
        return action


def tensors_in_file(network: StackedMLP) -> dict[str, Tensor]:
    """Weights (O, I) and biases (O,) by the names that a file has for them, as views."""
    named: dict[str, Tensor] = {}
    for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
        named |= {f"{2 * layer}.weight": weight[0].T, f"{2 * layer}.bias": bias[0, 0]}
    return named


def save_ppo_policy(path: Path, ppo: Learner, names: Sequence[str] | None = None) -> None:
    """Write the policy network, its spread and the moments of what it sees, with what rebuilds it in the metadata.

    `names`: of the columns of its observations.
    """
    tensors = {name: tensor.cpu() for name, tensor in tensors_in_file(ppo.policy).items()}
    if ppo.observations.enabled:
        tensors |= dict(
            zip(OBSERVATION_MOMENTS, (moment.cpu() for moment in ppo.observations.mean_and_scale()), strict=True)
        )
    sizes = {"input_size": ppo.policy.sizes[0], "output_size": len(ppo.log_std)}
    spec = {"algorithm": "ppo", COLUMN_NAMES: names, **sizes, **ppo.spec}
    save_tensors(path, tensors | {"log_std": ppo.log_std.cpu()}, {NETWORK: json.dumps(spec)})


def load_ppo_policy(path: Path, fits: Mapping[str, object] | None = None, names: Sequence[str] = ()) -> PPOPolicy:
    """Deterministic policy from a file of `save_ppo_policy`. Raises ArtifactError for any other.

    `fits`: what the description of its network must say, such as input_size; `names`: what its columns must be called.
    """
    sizes, options = ("input_size", "output_size"), {"activation": ACTIVATIONS}
    tensors, spec, _, columns = read_policy(path, algorithm="ppo", sizes=sizes, options=options)
    for name, needed in (fits or {}).items():
        require(path, name, spec[name], needed)
    require_names(path, columns, names)
    shapes: dict[str, tuple[int, ...]] = {"log_std": (spec["output_size"],)}
    for layer, (inputs, outputs) in enumerate(layer_sizes(spec, *sizes)):
        shapes |= {f"{2 * layer}.weight": (outputs, inputs), f"{2 * layer}.bias": (outputs,)}
    normalized = not tensors.keys().isdisjoint(OBSERVATION_MOMENTS)
    if normalized:
        shapes |= dict.fromkeys(OBSERVATION_MOMENTS, (spec["input_size"],))
    check_tensors(path, tensors, {name: (torch.float32, shape) for name, shape in shapes.items()})
    inputs, outputs = (spec.pop(name) for name in sizes)
    network = StackedMLP(stack=1, inputs=inputs, outputs=outputs, linear=True, exact=True, **spec)
    for name, tensor in tensors_in_file(network).items():
        tensor.copy_(tensors[name])
    return PPOPolicy(
        network, (tensors[OBSERVATION_MOMENTS[0]], tensors[OBSERVATION_MOMENTS[1]]) if normalized else None
    )
