"""The graph of a policy does what the policy does, whatever its network, columns and mirrors are."""

from __future__ import annotations

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from romgrl.algorithms.networks.stacked_mlp import StackedMLP
from romgrl.algorithms.onnx_policy import onnx_policy
from romgrl.algorithms.sac import Mirrors, SACPolicy
from romgrl.gait.symmetry import Mirror

OBSERVATIONS, ACTIONS = 12, 4
COLUMNS = torch.tensor([11, 0, 3, 4, 7, 2])  # some, in another order, the last one among them
LIMITS = (np.array([-1.0, 0.5, -30.0, 2.0]), np.array([1.0, 0.7, 10.0, 2.0]))


def small_policy(*, layer_norm: bool, mirrored: bool) -> SACPolicy:
    torch.manual_seed(0)
    network = StackedMLP(stack=1, inputs=len(COLUMNS), hidden_sizes=[16, 8], outputs=2 * ACTIONS, layer_norm=layer_norm)
    mirrors = Mirrors(
        Mirror(torch.tensor([1, 0, 2, 4, 3, 5]), torch.tensor([1.0, 1.0, -1.0, 1.0, 1.0, -1.0])),
        Mirror(torch.tensor([2, 3, 0, 1]), torch.tensor([1.0, -1.0, 1.0, -1.0])),
    )
    moments = torch.randn(len(COLUMNS)), torch.rand(len(COLUMNS)) + 0.5
    return SACPolicy(network, COLUMNS, *moments, mirrors=mirrors if mirrored else None)


def outputs_of(content: bytes, observation: np.ndarray) -> dict[str, np.ndarray]:
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, {"observation": observation}), strict=True))


@pytest.mark.parametrize("layer_norm", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_any_number_of_rows_gives_the_policys_actions_and_controls(layer_norm: bool, mirrored: bool) -> None:
    policy = small_policy(layer_norm=layer_norm, mirrored=mirrored)
    content = onnx_policy(policy, observations=OBSERVATIONS, limits=LIMITS)
    assert onnx_policy(policy, observations=OBSERVATIONS, limits=LIMITS) == content
    seen = 3.0 * np.random.default_rng(0).standard_normal((50, OBSERVATIONS)).astype(np.float32)
    low, high = LIMITS
    for rows in (1, 2, 7, 50):
        found, action = outputs_of(content, seen[:rows]), policy(seen[:rows])
        assert found["action"].shape == found["control"].shape == (rows, ACTIONS)
        np.testing.assert_allclose(found["action"], action, rtol=0, atol=1e-6)
        np.testing.assert_allclose(found["control"], low + (high - low) * (action + 1) / 2, rtol=0, atol=3e-5)
    assert np.ptp(policy(seen), axis=0).min() > 0.01  # the actions say something


def test_the_ends_of_an_action_are_the_ends_of_the_controls() -> None:
    policy = small_policy(layer_norm=False, mirrored=False)
    policy.policy.biases[-1][0, 0, :ACTIONS] = torch.tensor([99.0, -99.0, -99.0, 99.0])
    content = onnx_policy(policy, observations=OBSERVATIONS, limits=LIMITS)
    (control,) = outputs_of(content, np.zeros((1, OBSERVATIONS), np.float32))["control"]
    assert control == pytest.approx([1.0, 0.5, -30.0, 2.0])


def test_without_limits_the_graph_ends_at_the_action() -> None:
    content = onnx_policy(small_policy(layer_norm=True, mirrored=True), observations=OBSERVATIONS, limits=None)
    assert [output.name for output in onnx.load_from_string(content).graph.output] == ["action"]
    assert [*outputs_of(content, np.zeros((3, OBSERVATIONS), np.float32))] == ["action"]
