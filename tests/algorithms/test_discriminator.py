"""Discriminator loss, gradient penalty and imitation reward against numbers worked out on paper."""

import copy
import math
from typing import Any

import pytest
import torch

from romgrl.algorithms.adversarial_losses import LOSSES, interpolate_penalty
from romgrl.algorithms.discriminator import Discriminator


def make(**changes: Any) -> Discriminator:
    generator = torch.Generator().manual_seed(0)
    settings: dict[str, Any] = {
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
    return Discriminator(**(settings | changes))


def test_loss_on_paper() -> None:
    """Labels 0.9 and 0.1, D(real) = 0.8, D(fake) = 0.3."""
    real, fake = torch.tensor([math.log(0.8 / 0.2)]), torch.tensor([math.log(0.3 / 0.7)])
    expected = -(0.9 * math.log(0.8) + 0.1 * math.log(0.2)) - (0.1 * math.log(0.3) + 0.9 * math.log(0.7))
    assert float(LOSSES["bce"].loss(real, fake, 0.1)) == pytest.approx(expected, rel=1e-6)


def test_loss_of_an_undecided_judge_is_two_log_two() -> None:
    zero = torch.zeros(7)
    assert float(LOSSES["bce"].loss(zero, zero, 0.1)) == pytest.approx(2 * math.log(2), rel=1e-6)


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


def test_a_column_of_less_weight_counts_less_and_has_more_noise() -> None:
    """A logit moves with the weighted column as with one whose unit is larger; noise is the same to the network."""
    weights = torch.tensor([1.0, 1.0, 0.25, 1.0, 0.0])
    plain, weighted = make(dropout=0.0), make(dropout=0.0, weights=weights)
    windows = plain.mean + torch.randn((8, 5), generator=torch.Generator().manual_seed(1))
    closer = plain.mean + weights * (windows - plain.mean)
    torch.testing.assert_close(weighted.logits(windows), plain.logits(closer))
    still = torch.zeros((20_000, 5))
    spread = weighted._perturb(still)[:, :4].std(0) / plain._perturb(still)[:, :4].std(0)
    torch.testing.assert_close(spread, 1 / weights[:4], rtol=0.05, atol=0.0)


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
    discriminator = make(learning_rate=1e-30, patience=10, noise=0.0, early_stop="held_out")
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


def test_noise_is_in_standard_deviations_where_features_are_standardised() -> None:
    """In the units of each column then, in units of the features else."""
    scales = torch.tensor([0.01, 0.1, 1.0, 10.0, 100.0])
    reference = torch.randn((4000, 5), generator=torch.Generator().manual_seed(0)) * scales
    for standardize, expected in ((True, 0.5 * reference.std(0)), (False, torch.full((5,), 0.5))):
        discriminator = make(reference=reference, noise=0.5, standardize=standardize)
        added = discriminator._perturb(torch.zeros(20_000, 5))
        torch.testing.assert_close(added.std(0), expected, rtol=0.03, atol=0.0)
        torch.testing.assert_close(added.mean(0), torch.zeros(5), rtol=0.0, atol=0.02 * float(expected.max()))


@pytest.mark.parametrize(("shift", "rises"), [(3.0, True), (0.0, False)])
def test_adaptive_noise_rises_where_told_apart_and_falls_where_not(shift: float, rises: bool) -> None:
    """exp(0.01 (share told apart - accuracy)) per update."""
    discriminator, fixed = make(accuracy=0.75, dropout=0.0), make(dropout=0.0)
    generator = torch.Generator().manual_seed(1)
    fixed.update(torch.zeros(8, 5))
    for _ in range(100):
        before = discriminator.noise.clone()
        windows = torch.randn((256, 5), generator=generator) * 0.1 + 1.0 + 0.1 * shift
        metrics = discriminator.update(windows)
        told = 0.5 * (metrics["discriminator_accuracy_teacher"] + metrics["discriminator_accuracy_student"])
        torch.testing.assert_close(discriminator.noise, before * torch.exp(0.01 * (told - 0.75)))
        assert torch.equal(metrics["discriminator_noise"], discriminator.noise)
    assert (float(discriminator.noise) > 0.055) == rises
    assert (float(discriminator.noise) < 0.045) == (not rises)
    assert float(fixed.noise) == pytest.approx(0.05)


def test_adaptive_noise_has_bounds() -> None:
    for noise, bound in ((1e-4, 0.02), (50.0, 3.0)):
        discriminator = make(accuracy=0.75, noise=noise)
        discriminator.update(torch.zeros(32, 5))
        assert float(discriminator.noise) == pytest.approx(bound)


def test_a_restored_discriminator_goes_on_with_its_noise() -> None:
    windows = torch.randn((64, 5), generator=torch.Generator().manual_seed(1))
    whole, second = make(accuracy=0.75), make(accuracy=0.75, noise=0.4)
    for _ in range(30):
        whole.update(windows)
    assert float(whole.noise) != pytest.approx(0.05)
    state = copy.deepcopy(whole.state())
    first = whole.update(windows)
    second.restore(state)
    assert torch.equal(second.noise, state["tensors"]["noise"])
    again = second.update(windows)
    assert all(torch.equal(first[name], again[name]) for name in first)


def test_too_little_reference_is_refused() -> None:
    with pytest.raises(ValueError, match="held_out"):
        make(reference=torch.ones(1, 5))
