"""Values and gradients of the networks against torch's own, in float64."""

import pytest
import torch
from torch.nn import functional

from romgrl.algorithms.networks.stacked_mlp import ACTIVATIONS, StackedMLP
from tests.helpers.automatic_gradients import forward_by_autograd


@pytest.mark.parametrize("outputs", [1, 4])
@pytest.mark.parametrize("hidden_sizes", [[16, 12], []])
@pytest.mark.parametrize(("stack", "linear"), [(1, True), (1, False), (2, False), (3, False)])
@pytest.mark.parametrize("layer_norm", [False, True])
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_gradients_equal_automatic_ones(
    activation: str, layer_norm: bool, stack: int, linear: bool, hidden_sizes: list[int], outputs: int
) -> None:
    torch.manual_seed(0)
    network = StackedMLP(
        stack=stack,
        inputs=7,
        hidden_sizes=hidden_sizes,
        outputs=outputs,
        activation=activation,
        layer_norm=layer_norm,
        linear=linear,
        dtype=torch.float64,
    )
    inputs, tape = torch.randn(9, 7, dtype=torch.float64), network.tape(9)
    by_output = torch.randn(stack, 9, outputs, dtype=torch.float64)
    flat, leaf = network.flat.clone().requires_grad_(), inputs.clone().requires_grad_()
    expected = forward_by_autograd(network, activation, flat, leaf)
    by_flat, by_leaf = torch.autograd.grad((expected * by_output).sum(), (flat, leaf))
    torch.testing.assert_close(network.forward(inputs, tape), expected.detach(), rtol=1e-12, atol=1e-12)
    by_input = network.backward(by_output, tape, inputs=slice(5, 7))
    torch.testing.assert_close(network.gradient, by_flat, rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(by_input, by_leaf[:, 5:7], rtol=1e-10, atol=1e-12)


def test_gradients_are_only_written_where_they_are_wanted() -> None:
    network = StackedMLP(stack=2, inputs=3, hidden_sizes=[4], outputs=1, layer_norm=True)
    tape = network.tape(5)
    network.forward(torch.ones(5, 3), tape)
    assert network.backward(torch.ones(2, 5, 1), tape, weights=False).numel() == 0
    assert not network.gradient.any()
    network.backward(torch.ones(2, 5, 1), tape)
    assert network.gradient.any()


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_activations(activation: str, exact: bool) -> None:
    """One unit with weight 1: the function itself, to the last bit if it is exact."""
    network = StackedMLP(stack=1, inputs=1, hidden_sizes=[1], outputs=1, activation=activation, exact=exact)
    network.flat.copy_(torch.tensor([1.0, 0.0, 1.0, 0.0]))
    inputs = torch.linspace(-20.0, 20.0, 801)[:, None]
    expected = getattr(functional, activation)(inputs)
    error = (network.forward(inputs, network.tape(801))[0] - expected).abs().max()
    assert error <= (0.0 if exact or activation != "tanh" else 2e-7)


def test_what_fits_no_network() -> None:
    with pytest.raises(ValueError, match="activation must be one of tanh, relu, elu, not 'swish'"):
        StackedMLP(stack=1, inputs=2, hidden_sizes=[2], outputs=1, activation="swish")
    with pytest.raises(ValueError, match="stack of 1, not 2"):
        StackedMLP(stack=2, inputs=2, hidden_sizes=[2], outputs=1, linear=True)


@pytest.mark.parametrize(("stack", "linear"), [(1, True), (2, False)])
def test_orthogonal_initialisation(stack: int, linear: bool) -> None:
    network = StackedMLP(stack=stack, inputs=4, hidden_sizes=[8, 8], outputs=2, linear=linear)
    network.initialise_orthogonal(output_gain=0.01)
    for hidden, output in zip(network.weights[1], network.weights[2], strict=True):
        torch.testing.assert_close(hidden @ hidden.T, 2.0 * torch.eye(8), rtol=0, atol=1e-5)
        torch.testing.assert_close(output.T @ output, 1e-4 * torch.eye(2), rtol=0, atol=1e-8)
    assert not any(bias.any() for bias in network.biases)


def test_first_weights_are_those_of_linear_layers() -> None:
    network = StackedMLP(stack=2, inputs=400, hidden_sizes=[100], outputs=25)
    for values in (network.weights[0], network.biases[0]):
        assert 0.9 / 20 < values.abs().max() <= 1 / 20


def test_parameters_in_a_part_of_a_longer_vector() -> None:
    """They keep their values, and gradients go where the part of the other vector lies."""
    network = StackedMLP(stack=1, inputs=3, hidden_sizes=[4], outputs=2, linear=True)
    inputs, size = torch.ones(5, 3), len(network.flat)
    expected = network.forward(inputs, network.tape(5)).clone()
    flat, gradient = torch.cat((torch.zeros(2), network.flat)), torch.zeros(size + 2)
    network.place(flat[2:], gradient[2:])
    tape = network.kept_tape(5, "test")
    assert torch.equal(network.forward(inputs, tape), expected)
    network.backward(torch.ones(1, 5, 2), tape)
    assert not gradient[:2].any()
    assert torch.equal(gradient[-2:], torch.full((2,), 5.0))  # by the biases of the outputs
    assert torch.equal(flat[2:14].view(4, 3), network.weights[0][0].T)


def test_a_tape_is_kept_for_each_use_and_number_of_rows() -> None:
    network = StackedMLP(stack=1, inputs=3, hidden_sizes=[4], outputs=2)
    kept = network.kept_tape(5, "act")
    assert network.kept_tape(5, "act") is kept
    assert network.kept_tape(6, "act") is not kept
    assert network.kept_tape(5, "gradient") is not kept
    assert network.tape(5) is not kept
