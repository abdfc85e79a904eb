"""Multilayer perceptrons of one shape, evaluated and differentiated as one stacked product.

The gradients are written out, because the learner needs few of those that automatic differentiation computes: none of
the targets, none of the critics' weights in the policy's update, of their inputs only the actions. For a hidden layer
    z = x W + b,  y = LN(z) or z,  a = max(y, 0),  LN(z) = (z - mean z) / sqrt(var z + eps)
and a gradient g of the loss by a, the chain rule gives
    g_y = g [a > 0],  g_z = (g_y - mean g_y - y mean(g_y y)) / sqrt(var z + eps) or g_y,
    g_W = x^T g_z,  g_b = sum g_z,  g_x = g_z W^T.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

EPSILON = 1e-5
KINDS = ("weight", "bias")


@dataclass
class Tape:
    """Buffers of one forward pass, which the backward pass reads; the next pass writes over them."""

    inputs: list[Tensor]  # of each layer, (S, B, I)
    centred: list[Tensor]  # z - mean z of each hidden layer, (S, B, O); none without layer norm
    scale: list[Tensor]  # 1 / sqrt(var z + eps), (S, B, 1); none without layer norm
    output: Tensor  # (S, B, O)


class StackedMLP:
    """`stack` perceptrons with ReLU, their parameters in one flat vector and the gradients in another.

    Inputs (B, I) are shared by all; outputs are (stack, B, O).
    """

    def __init__(
        self,
        *,
        stack: int,
        inputs: int,
        hidden_sizes: Sequence[int],
        outputs: int,
        layer_norm: bool,
        device: str = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        self.stack, self.layer_norm = stack, layer_norm
        self.sizes = [inputs, *hidden_sizes, outputs]
        total = sum(stack * (i + 1) * o for i, o in pairwise(self.sizes))
        self.flat = torch.zeros(total, device=device, dtype=dtype)
        self.gradient = torch.zeros_like(self.flat)
        self.flat.grad = self.gradient  # where optimisers look for it
        self.weights, self.biases = self._views(self.flat)
        self.weight_gradients, self.bias_gradients = self._views(self.gradient)
        for weight, bias in zip(self.weights, self.biases, strict=True):
            bound = 1 / math.sqrt(weight.shape[1])  # as torch.nn.Linear
            weight.uniform_(-bound, bound)
            bias.uniform_(-bound, bound)

    def _views(self, flat: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Weights (S, I, O) and biases (S, 1, O) of all layers as views of a flat vector."""
        weights, biases, start = [], [], 0
        for i, o in pairwise(self.sizes):
            weights.append(flat[start : start + self.stack * i * o].view(self.stack, i, o))
            start += self.stack * i * o
            biases.append(flat[start : start + self.stack * o].view(self.stack, 1, o))
            start += self.stack * o
        return weights, biases

    def named_tensors(self) -> dict[str, Tensor]:
        """Weights (S, I, O) and biases (S, 1, O) by name, as views."""
        pairs = enumerate(zip(self.weights, self.biases, strict=True))
        return {f"{kind}_{layer}": value for layer, pair in pairs for kind, value in zip(KINDS, pair, strict=True)}

    def tape(self, batch: int) -> Tape:
        """Buffers for passes over `batch` rows."""

        def empty(columns: int) -> Tensor:
            return self.flat.new_empty((self.stack, batch, columns))

        hidden = self.sizes[1:-1]
        return Tape(
            inputs=[empty(0), *map(empty, hidden)],
            centred=[empty(size) for size in hidden if self.layer_norm],
            scale=[empty(1) for _ in hidden if self.layer_norm],
            output=empty(self.sizes[-1]),
        )

    def forward(self, inputs: Tensor, tape: Tape) -> Tensor:
        """Outputs (S, B, O) for inputs (B, I), in a buffer of the tape."""
        tape.inputs[0] = inputs.expand(self.stack, -1, -1)
        for layer in range(len(self.sizes) - 2):
            z = following = tape.inputs[layer + 1]
            if self.layer_norm:
                z, scale = tape.centred[layer], tape.scale[layer]
            torch.baddbmm(self.biases[layer], tape.inputs[layer], self.weights[layer], out=z)
            if self.layer_norm:
                z.sub_(z.mean(-1, keepdim=True))
                torch.linalg.vector_norm(z, dim=-1, keepdim=True, out=scale)
                scale.square_().mul_(1 / z.shape[-1]).add_(EPSILON).rsqrt_()
                torch.mul(z, scale, out=following)
            following.relu_()
        return self._head(tape.inputs[-1], tape.output)

    def _head(self, x: Tensor, output: Tensor) -> Tensor:
        if self.sizes[-1] > 1:
            return torch.baddbmm(self.biases[-1], x, self.weights[-1], out=output)
        # One column: reductions, several times faster than a product with a vector.
        return torch.sum(x * self.weights[-1].mT, -1, keepdim=True, out=output).add_(self.biases[-1])

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
            gradient = gradient * weight.mT if weight.shape[2] == 1 else torch.bmm(gradient, weight.mT)
            torch.ops.aten.threshold_backward.grad_input(gradient, x, 0, grad_input=gradient)
            if self.layer_norm:
                z, scale = tape.centred[layer - 1], tape.scale[layer - 1]
                gradient = torch.ops.aten.native_layer_norm_backward(
                    gradient, z, z.shape[-1:], torch.zeros_like(scale), scale, None, None, [True, False, False]
                )[0]
        if inputs is None:
            return gradient.new_empty((0,))
        return torch.bmm(gradient, self.weights[0][:, inputs].mT).sum(0)

    def _weight_gradient(self, layer: int, x: Tensor, gradient: Tensor) -> None:
        if gradient.shape[2] == 1:
            torch.sum(x * gradient, 1, out=self.weight_gradients[layer].squeeze(-1))
        else:
            torch.bmm(x.mT, gradient, out=self.weight_gradients[layer])
        torch.sum(gradient, 1, keepdim=True, out=self.bias_gradients[layer])
