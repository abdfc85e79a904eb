"""Discriminator loss, gradient penalty and imitation reward against numbers worked out on paper."""

import math

import pytest
import torch

from romgrl.algorithms.adversarial_losses import LOSSES, bce_loss, interpolate_penalty
from romgrl.algorithms.discriminator import Discriminator


def make(**changes: object) -> Discriminator:
    generator = torch.Generator().manual_seed(0)
    settings: dict[str, object] = {
        "reference": torch.randn((400, 5), generator=generator) * 0.1 + 1.0,
        "hidden_sizes": [64, 32],
        "dropout": 0.2,
        "learning_rate": 1e-3,
        "penalty_weight": 1.0,
        "label_smoothing": 0.1,
        "noise": 0.05,
        "reward_limit": 3.0,
        "held_out": 0.1,
        "patience": None,
        "standardize": True,
        "seed": 0,
    }
    return Discriminator(**(settings | changes))  # type: ignore[arg-type]


def test_loss_on_paper() -> None:
    """Labels 0.9 and 0.1, D(real) = 0.8, D(fake) = 0.3."""
    real, fake = torch.tensor([math.log(0.8 / 0.2)]), torch.tensor([math.log(0.3 / 0.7)])
    expected = -(0.9 * math.log(0.8) + 0.1 * math.log(0.2)) - (0.1 * math.log(0.3) + 0.9 * math.log(0.7))
    assert float(bce_loss(real, fake, 0.1)) == pytest.approx(expected, rel=1e-6)


def test_loss_of_an_undecided_judge_is_two_log_two() -> None:
    zero = torch.zeros(7)
    assert float(bce_loss(zero, zero, 0.1)) == pytest.approx(2 * math.log(2), rel=1e-6)


def test_gradient_penalty_of_linear_and_quadratic_judges() -> None:
    """A linear discriminator has gradient w everywhere; x^2 / 2 has gradient x, here at x = (0.25 * 4, 0.25 * 8)."""
    weight = torch.tensor([3.0, 4.0])
    real, fake, mix = torch.zeros(2, 2), torch.tensor([[4.0, 8.0]] * 2), torch.full((2, 1), 0.75)
    assert float(interpolate_penalty(lambda x: x @ weight, real, fake, mix)) == pytest.approx(16.0)
    quadratic = interpolate_penalty(lambda x: 0.5 * x.square().sum(-1), real, fake, mix)
    assert float(quadratic.detach()) == pytest.approx((math.sqrt(5) - 1) ** 2, rel=1e-6)


def test_imitation_reward_is_minus_log_one_minus_d() -> None:
    probability = torch.tensor([0.1, 0.5, 0.9, 1 - 1e-6])
    logits = torch.log(probability / (1 - probability))
    torch.testing.assert_close(LOSSES["bce"].paid(logits, torch.zeros(()), None)[:3], -torch.log(1 - probability[:3]))
    assert float(LOSSES["bce"].paid(logits, torch.zeros(()), 3.0)[3]) == 3.0


def test_it_learns_to_tell_and_rewards_what_looks_real() -> None:
    discriminator = make(dropout=0.0)
    generator = torch.Generator().manual_seed(1)
    for _ in range(300):
        metrics = discriminator.update(torch.randn((64, 5), generator=generator) * 0.1)
    assert metrics["discriminator_accuracy_teacher"] > 0.95
    assert metrics["discriminator_accuracy_student"] > 0.95
    assert float(metrics["discriminator_gradient_norm"]) > 0
    real, fake = discriminator.reward(discriminator.real), discriminator.reward(torch.zeros(10, 5))
    assert real.mean() > math.log(2) > fake.mean()


def test_held_out_windows_are_the_last_tenth() -> None:
    discriminator = make()
    assert len(discriminator.real) == 360
    assert len(discriminator.validation) == 40


def test_it_stops_after_patience_updates_without_improvement() -> None:
    discriminator = make(learning_rate=1e-30, patience=10, noise=0.0)
    fake = torch.zeros(32, 5)
    updates = 0
    while not discriminator.stopped and updates < 500:
        discriminator.update(fake)
        updates += 1
    assert discriminator.stopped
    assert updates >= 11
    assert int(discriminator.stale_updates) == 10


def test_reward_has_no_dropout() -> None:
    discriminator = make(dropout=0.5)
    frames = torch.ones(8, 5)
    discriminator.update(frames)
    assert torch.equal(discriminator.reward(frames), discriminator.reward(frames))


def test_too_little_reference_is_refused() -> None:
    with pytest.raises(ValueError, match="held_out"):
        make(reference=torch.ones(1, 5))
