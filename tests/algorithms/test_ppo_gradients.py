"""PPO's losses by hand, and its written-out gradients against those of automatic differentiation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from romgrl.algorithms.ppo import (
    clipped_policy_loss,
    gaussian_log_probability,
)
from romgrl.gait.symmetry import Mirror
from tests.algorithms.small_ppo import filled_rollout, make_ppo, networks, normal


def test_clipped_loss_by_hand() -> None:
    # Ratios 1.5, 0.5, 1.5, 0.5, 1.1 with advantages 1, 1, -1, -1, 2 and clip 0.2:
    # min(1.5, 1.2) = 1.2, min(0.5, 0.8) = 0.5, min(-1.5, -1.2) = -1.5, min(-0.5, -0.8) = -0.8, 2.2; mean 0.32.
    ratios = torch.tensor([1.5, 0.5, 1.5, 0.5, 1.1])
    assert clipped_policy_loss(ratios.log(), torch.tensor([1.0, 1.0, -1.0, -1.0, 2.0]), 0.2).item() == pytest.approx(
        -0.32, abs=1e-6
    )


def test_clipped_loss_stops_the_gradient_beyond_the_clip() -> None:
    log_ratio = torch.tensor([1.5, 0.5, 1.5, 0.5]).log().requires_grad_()
    clipped_policy_loss(log_ratio, torch.tensor([1.0, 1.0, -1.0, -1.0]), 0.2).backward()
    # d/d(log r) of -r A / 4 where the minimum is not clipped: r = 0.5, A = 1 and r = 1.5, A = -1.
    assert log_ratio.grad is not None
    torch.testing.assert_close(log_ratio.grad, torch.tensor([0.0, -0.125, 0.375, 0.0]))


def test_gaussian_density() -> None:
    # N(0.5; 0, 2) x N(-1; 1, 0.5): exponents -0.03125 and -8, sum of log std 0, log(2 pi) once for two halves.
    log_std = torch.tensor([math.log(2.0), math.log(0.5)])
    scaled = (torch.tensor([[0.5, -1.0]]) - torch.tensor([[0.0, 1.0]])) / log_std.exp()
    density = gaussian_log_probability(scaled, log_std)
    assert density.item() == pytest.approx(-8.03125 - math.log(2 * math.pi), abs=1e-6)


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu"])
@pytest.mark.parametrize("hidden_sizes", [[16, 12, 8], []])
def test_gradients_are_those_of_automatic_differentiation(activation: str, hidden_sizes: list[int]) -> None:
    """In float64, with ratios on both sides of the clip, an entropy bonus, and half of the minibatch mirrored."""
    pair = Mirror(np.array([1, 0, 2]), np.array([1.0, 1.0, -1.0], np.float32))
    mirrors = {"mirror_observation": pair, "mirror_action": pair.kept(np.arange(2))}
    settings: dict[str, Any] = {"activation": activation, "hidden_sizes": hidden_sizes, "minibatch_size": 32}
    torch.set_default_dtype(torch.float64)
    try:
        ppo = make_ppo(**settings, **mirrors, entropy_coefficient=0.03)
    finally:
        torch.set_default_dtype(torch.float32)
    generator = torch.Generator().manual_seed(1)
    ppo.weights.add_(torch.randn(ppo.weights.shape, generator=generator, dtype=torch.float64), alpha=0.2)
    rollout = filled_rollout()
    for name, tensor in vars(rollout).items():
        setattr(rollout, name, tensor.double() if tensor.is_floating_point() else tensor)
    mean, log_std, _ = networks(ppo, ppo.weights, rollout.observations)
    rollout.log_probabilities = normal(mean, log_std).log_prob(rollout.actions)
    rollout.log_probabilities += 0.5 * torch.randn(8, 4, generator=generator, dtype=torch.float64)
    samples = ppo._samples(rollout, rollout.rewards, rollout.rewards.exp(), rollout.rewards)
    minibatch = next(ppo._minibatches(samples, 32))

    log_ratio = ppo.policy_gradient(minibatch)
    ppo.value_gradient(minibatch)
    written_out = ppo.gradient.clone()

    weights = ppo.weights.clone().requires_grad_()
    mean, log_std, values = networks(ppo, weights, minibatch.observations)
    by_autograd = normal(mean, log_std).log_prob(minibatch.actions) - minibatch.log_probabilities
    loss = clipped_policy_loss(by_autograd, minibatch.advantages, ppo.clip_ratio)
    loss = loss + ppo.value_coefficient * 0.5 * (values - minibatch.returns).square().mean()
    loss = loss - 0.03 * normal(mean, log_std).entropy().mean()
    (expected,) = torch.autograd.grad(loss, weights)

    torch.testing.assert_close(log_ratio, by_autograd, rtol=0, atol=1e-12)
    clipped = (log_ratio.exp() - 1.0).abs() > ppo.clip_ratio
    assert 0.2 < clipped.double().mean() < 0.9
    torch.testing.assert_close(written_out, expected, rtol=1e-9, atol=1e-12)


def test_gradient_is_clipped_over_both_networks() -> None:
    """The norm that is reported is the one before clipping; what is left has the length of the limit."""
    ppo = make_ppo(max_gradient_norm=0.01)
    rollout = filled_rollout()
    minibatch = next(ppo._minibatches(ppo._samples(rollout, *[rollout.rewards] * 3), 32))
    ppo.policy_gradient(minibatch)
    ppo.value_gradient(minibatch)
    norm = ppo.gradient.norm()
    _, _, reported = ppo._update_minibatch(minibatch)
    assert norm > 0.1
    assert reported.item() == pytest.approx(norm.item(), rel=1e-6)
    assert ppo.gradient.norm().item() == pytest.approx(0.01, rel=1e-4)
