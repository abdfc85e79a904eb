"""A trained SAC policy as an ONNX graph, which no part of this package and no torch is needed to run."""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, checker, helper, numpy_helper
from torch import Tensor

from romgrl.algorithms.networks.stacked_mlp import EPSILON, StackedMLP
from romgrl.algorithms.sac import SACPolicy

OPSET, IR_VERSION = 17, 8  # of 2022, so that older runtimes read it; LayerNormalization is from 17
Limits = tuple[NDArray[np.float64], NDArray[np.float64]]


def onnx_policy(policy: SACPolicy, *, observations: int, limits: Limits | None, commands: int = 0) -> bytes:
    """The file of a graph that does what the policy does, and scales its action as `limits` say.

    Its input is `observation` (N, O), float32, all O = `observations` columns as the environment gives them, for any N.
    Of a policy that follows commands `command` (N, C) is another one, the C = `commands` columns behind those.
    Outputs are `action` (N, A) in [-1, 1] and, with `limits`, `control` (N, A), low + (high - low) (action + 1) / 2.

    limits: the least and the largest control of each actuator, (A,) each, in its unit; None: no `control`.
    """
    graph, inputs_of = Graph(), {"observation": observations} | ({"command": commands} if commands else {})
    columns = graph.add("Concat", *inputs_of, axis=1) if commands else "observation"
    seen = graph.add("Gather", columns, graph.constant("columns", policy.columns), axis=1)
    if policy.mirrors is not None:
        seen = graph.add("Concat", seen, image(graph, seen, "observation", *policy.mirrors.observation), axis=0)
    centred = graph.add("Sub", seen, graph.constant("observation_mean", policy.mean))
    inputs = graph.add("Mul", centred, graph.constant("observation_scale", policy.scale))
    means = mean_head(graph, inputs, policy.policy)
    if policy.mirrors is None:
        graph.add("Tanh", means, name="action")
    else:
        graph.nodes.append(helper.make_node("Split", [graph.add("Tanh", means)], ["straight", "mirrored"], axis=0))
        total = graph.add("Add", "straight", image(graph, "mirrored", "action", *policy.mirrors.action))
        graph.add("Mul", total, graph.constant("half", np.float32(0.5)), name="action")
    names = ["action"]
    if limits is not None:
        low, high = limits
        from_low = graph.add("Add", "action", graph.constant("one", np.float32(1.0)))
        half_range = graph.constant("half_range", (0.5 * (high - low)).astype(np.float32))
        scaled = graph.add("Mul", from_low, half_range)
        graph.add("Add", scaled, graph.constant("lowest_control", low.astype(np.float32)), name="control")
        names.append("control")
    return graph.file(inputs_of, dict.fromkeys(names, policy.policy.sizes[-1] // 2))


def image(graph: Graph, values: str, of: str, permutation: Tensor, sign: Tensor) -> str:
    """The mirror image of `values`, as `Mirror.image` makes it."""
    permuted = graph.add("Gather", values, graph.constant(f"mirror_{of}_permutation", permutation), axis=1)
    return graph.add("Mul", permuted, graph.constant(f"mirror_{of}_sign", sign))


def mean_head(graph: Graph, inputs: str, network: StackedMLP) -> str:
    """The means before the tanh: the network without the outputs that are deviations."""
    values, last = inputs, len(network.weights) - 1
    for layer, (weights, biases) in enumerate(zip(network.weights, network.biases, strict=True)):
        used = slice(None) if layer < last else slice(network.sizes[-1] // 2)
        product = graph.add("MatMul", values, graph.constant(f"weight_{layer}", weights[0][:, used]))
        values = graph.add("Add", product, graph.constant(f"bias_{layer}", biases[0, 0, used]))
        if layer == last:
            break
        if network.layer_norm:
            scale = graph.constant(f"norm_{layer}", np.ones(network.sizes[layer + 1], np.float32))
            values = graph.add("LayerNormalization", values, scale, axis=-1, epsilon=EPSILON)
        values = graph.add("Relu", values)
    return values


class Graph:
    """Nodes and constants of a graph that is being made; every value goes by a name."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: dict[str, onnx.TensorProto] = {}

    def constant(self, name: str, value: Tensor | NDArray[np.float32] | np.float32) -> str:
        """A constant of that name."""
        array = value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)
        self.constants[name] = numpy_helper.from_array(np.ascontiguousarray(array), name)
        return name

    def add(self, operator: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """The output of a new node, called `name`, or after its operator and its place."""
        output = name or f"{operator}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, [*inputs], [output], **attributes))
        return output

    def file(self, inputs: dict[str, int], outputs: dict[str, int]) -> bytes:
        """The graph with `inputs` and `outputs`, by their columns: the same bytes every time."""

        def rows_of(name: str, columns: int) -> onnx.ValueInfoProto:
            return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", columns])

        read, values = ([rows_of(*each) for each in named.items()] for named in (inputs, outputs))
        constants = [*self.constants.values()]
        graph = helper.make_graph(self.nodes, "policy", read, values, constants)
        model = helper.make_model(
            graph, producer_name="romgrl", ir_version=IR_VERSION, opset_imports=[helper.make_opsetid("", OPSET)]
        )
        checker.check_model(model, full_check=True)
        content: bytes = model.SerializeToString(deterministic=True)
        return content
