"""Multilayer perceptrons of one shape, evaluated and differentiated as one stacked product.

The gradients are written out: automatic differentiation spends as long on its books as on products, and computes what
no learner needs, as the gradients of the critics' weights in the policy's update. For a hidden layer
    z = x W + b,  y = LN(z) or z,  a = f(y),  LN(z) = (z - mean z) / sqrt(var z + eps)
and a gradient g of the loss by a, the chain rule gives
    g_y = g f'(y),  g_z = (g_y - mean g_y - y mean(g_y y)) / sqrt(var z + eps) or g_y,
    g_W = x^T g_z,  g_b = sum g_z,  g_x = g_z W^T,
where f'(y) follows from a alone for every activation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

EPSILON = 1e-5
KINDS = ("weight", "bias")
MINUS_ONE = torch.tensor(-1.0)
ATEN = torch.ops.aten


class Activation(NamedTuple):
    """y -> f(y) and (g, f(y)) -> g f'(y); each overwrites its first argument."""

    apply: Callable[[Tensor], Tensor]
    gradient: Callable[[Tensor, Tensor], None]


def fast_tanh(y: Tensor) -> Tensor:
    """tanh y = 2 / (1 + exp(-2 y)) - 1 in place, to one rounding of 1; a quarter of the time of torch.tanh on a CPU."""
    return torch.add(MINUS_ONE, y.mul_(2.0).sigmoid_(), alpha=2.0, out=y)


def tanh_gradient(gradient: Tensor, output: Tensor) -> None:
    """f' = 1 - f^2."""
    ATEN.tanh_backward.grad_input(gradient, output, grad_input=gradient)


def relu_gradient(gradient: Tensor, output: Tensor) -> None:
    """f' = 1 where f > 0, 0 elsewhere."""
    ATEN.threshold_backward.grad_input(gradient, output, 0, grad_input=gradient)


def elu_gradient(gradient: Tensor, output: Tensor) -> None:
    """f' = 1 where f > 0, exp y = f + 1 elsewhere."""
    ATEN.elu_backward.grad_input(gradient, 1, 1, 1, True, output, grad_input=gradient)


ACTIVATIONS = {
    "tanh": Activation(fast_tanh, tanh_gradient),
    "relu": Activation(torch.relu_, relu_gradient),
    "elu": Activation(F.elu_, elu_gradient),
}
EXACT_TANH = Activation(torch.tanh_, tanh_gradient)


@dataclass
class Tape:
    """Buffers of one forward pass, which the backward pass reads; the next pass writes over them."""

    inputs: list[Tensor]  # of each layer, (S, B, I)
    centred: list[Tensor]  # z - mean z of each hidden layer, (S, B, O); none without layer norm
    scale: list[Tensor]  # 1 / sqrt(var z + eps), (S, B, 1); none without layer norm
    gradients: list[Tensor]  # of the loss by each hidden layer, (1, B, O), for the backward pass; none unless linear
    output: Tensor  # (S, B, O)


class StackedMLP:
    """`stack` perceptrons, their parameters in one flat vector and the gradients in another.

    Inputs (B, I) are shared by all; outputs are (stack, B, O). `activation` is a key of ACTIVATIONS, with `exact` to
    the last bit as torch has it. `linear`: one perceptron whose layers are torch.nn.Linear to the last bit; its weights
    lie as (O, I) in the vector, not as (stack, I, O). Raises ValueError for an unknown activation, and for
    `linear` with a stack.
    """

    def __init__(
        self,
        *,
        stack: int,
        inputs: int,
        hidden_sizes: Sequence[int],
        outputs: int,
        activation: str = "relu",
        layer_norm: bool = False,
        linear: bool = False,
        exact: bool = False,
        device: str = "cpu",
        dtype: torch.dtype | None = None,
    ) -> None:
        if activation not in ACTIVATIONS:
            raise ValueError(f"activation must be one of {', '.join(ACTIVATIONS)}, not {activation!r}")
        if linear and stack != 1:
            raise ValueError(f"linear needs a stack of 1, not {stack}")
        self.activation = EXACT_TANH if exact and activation == "tanh" else ACTIVATIONS[activation]
        self.stack, self.layer_norm, self.linear = stack, layer_norm, linear
        self.sizes = [inputs, *hidden_sizes, outputs]
        self._tapes: dict[tuple[str, int], Tape] = {}
        total = sum(stack * (i + 1) * o for i, o in pairwise(self.sizes))
        flat = torch.zeros(total, device=device, dtype=dtype)
        self.place(flat, torch.zeros_like(flat))
        for weight, bias in zip(self.weights, self.biases, strict=True):
            bound = 1 / math.sqrt(weight.shape[1])  # as torch.nn.Linear
            weight.uniform_(-bound, bound)
            bias.uniform_(-bound, bound)

    def place(self, flat: Tensor, gradient: Tensor) -> None:
        """From now on have the parameters in `flat` and their gradients in `gradient`, with what is in them."""
        self.flat, self.gradient = flat, gradient
        self.flat.grad = gradient  # where optimisers look for it
        self.weights, self.biases = self._views(flat)
        self.weight_gradients, self.bias_gradients = self._views(gradient)

    def initialise_orthogonal(self, output_gain: float, hidden_gain: float = math.sqrt(2.0)) -> None:
        """Orthogonal weights and zero biases, as PPO starts: a small `output_gain` gives small first outputs."""
        for layer, (weights, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            for weight in weights:
                nn.init.orthogonal_(weight.T, output_gain if layer == len(self.weights) - 1 else hidden_gain)
            bias.zero_()

    def _views(self, flat: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Weights (S, I, O) and biases (S, 1, O) of all layers as views of a flat vector."""
        weights, biases, start = [], [], 0
        for i, o in pairwise(self.sizes):
            part = flat[start : start + self.stack * i * o]
            weights.append(part.view(self.stack, o, i).mT if self.linear else part.view(self.stack, i, o))
            start += self.stack * i * o
            biases.append(flat[start : start + self.stack * o].view(self.stack, 1, o))
            start += self.stack * o
        return weights, biases

    def named_tensors(self) -> dict[str, Tensor]:
        """Weights (S, I, O) and biases (S, 1, O) by name, as views."""
        pairs = enumerate(zip(self.weights, self.biases, strict=True))
        return {f"{kind}_{layer}": value for layer, pair in pairs for kind, value in zip(KINDS, pair, strict=True)}

    def kept_tape(self, batch: int, use: str) -> Tape:
        """The one tape of this `use` with `batch` rows, which the network keeps."""
        if (use, batch) not in self._tapes:
            self._tapes[use, batch] = self.tape(batch)
        return self._tapes[use, batch]

    def tape(self, batch: int) -> Tape:
        """New buffers for passes over `batch` rows."""

        def empty(columns: int) -> Tensor:
            return self.flat.new_empty((self.stack, batch, columns))

        hidden = self.sizes[1:-1]
        return Tape(
            inputs=[empty(0), *map(empty, hidden)],
            centred=[empty(size) for size in hidden if self.layer_norm],
            scale=[empty(1) for _ in hidden if self.layer_norm],
            gradients=[empty(size) for size in hidden if self.linear],
            output=empty(self.sizes[-1]),
        )

    def forward(self, inputs: Tensor, tape: Tape) -> Tensor:
        """Outputs (S, B, O) for inputs (B, I), in a buffer of the tape."""
        tape.inputs[0] = inputs.expand(self.stack, -1, -1)
        for layer in range(len(self.sizes) - 2):
            z = following = tape.inputs[layer + 1]
            if self.layer_norm:
                z, scale = tape.centred[layer], tape.scale[layer]
            self._affine(layer, tape.inputs[layer], z)
            if self.layer_norm:
                z.sub_(z.mean(-1, keepdim=True))
                torch.linalg.vector_norm(z, dim=-1, keepdim=True, out=scale)
                scale.square_().mul_(1 / z.shape[-1]).add_(EPSILON).rsqrt_()
                torch.mul(z, scale, out=following)
            self.activation.apply(following)
        self._affine(-1, tape.inputs[-1], tape.output)
        return tape.output

    def _affine(self, layer: int, x: Tensor, output: Tensor) -> None:
        """Write x W + b, (S, B, O), for x (S, B, I)."""
        weight, bias = self.weights[layer], self.biases[layer]
        if self.linear:
            torch.addmm(bias[0], x[0], weight[0], out=output[0])
        elif weight.shape[2] > 1:
            torch.baddbmm(bias, x, weight, out=output)
        else:  # One column: reductions, several times faster than a stack of products with a vector.
            torch.sum(x * weight.mT, -1, keepdim=True, out=output).add_(bias)

    def backward(self, gradient: Tensor, tape: Tape, *, weights: bool = True, inputs: slice | None = None) -> Tensor:
        """From d loss / d output (S, B, O), write `gradient` (weights) and return d loss / d inputs[:, `inputs`].

        The latter is summed over the stack, (B, columns); without `inputs` it is not computed, and empty.
        """
        for layer in reversed(range(len(self.sizes) - 1)):
            x, weight = tape.inputs[layer], self.weights[layer]
            if weights:
                self._weight_gradient(layer, x, gradient)
            if layer == 0:
                break
            if self.linear:
                gradient = torch.mm(gradient[0], weight[0].T, out=tape.gradients[layer - 1][0])[None]
            else:
                gradient = gradient * weight.mT if weight.shape[2] == 1 else torch.bmm(gradient, weight.mT)
            self.activation.gradient(gradient, x)
            if self.layer_norm:
                z, scale = tape.centred[layer - 1], tape.scale[layer - 1]
                gradient = ATEN.native_layer_norm_backward(
                    gradient, z, z.shape[-1:], torch.zeros_like(scale), scale, None, None, [True, False, False]
                )[0]
        if inputs is None:
            return gradient.new_empty((0,))
        return torch.bmm(gradient, self.weights[0][:, inputs].mT).sum(0)

    def _weight_gradient(self, layer: int, x: Tensor, gradient: Tensor) -> None:
        if self.linear:
            torch.mm(x[0].T, gradient[0], out=self.weight_gradients[layer][0])
        elif gradient.shape[2] == 1:
            torch.sum(x * gradient, 1, out=self.weight_gradients[layer].squeeze(-1))
        else:
            torch.bmm(x.mT, gradient, out=self.weight_gradients[layer])
        torch.sum(gradient, 1, keepdim=True, out=self.bias_gradients[layer])
