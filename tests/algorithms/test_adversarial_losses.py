"""The discriminator's losses, rewards and penalties against closed forms, and its optimum between two Gaussians."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from romgrl.algorithms.adversarial_losses import (
    LOSSES,
    interpolate_penalty,
    zero_penalty,
)
from romgrl.algorithms.discriminator import Discriminator

ZERO = torch.zeros(())
REAL, FAKE = torch.tensor([0.5, 2.0]), torch.tensor([-1.0, 0.2])


@pytest.mark.parametrize(
    ("loss", "expected"),
    [
        ("least_squares", (0.25 + 1.0) / 2 + (0.0 + 1.44) / 2),
        ("wasserstein", (-1.0 + 0.2) / 2 - (0.5 + 2.0) / 2),
        ("bce", sum(math.log1p(math.exp(x)) for x in (-0.5, -2.0, -1.0, 0.2)) / 2),
    ],
)
def test_losses_on_paper(loss: str, expected: float) -> None:
    assert float(LOSSES[loss].loss(REAL, FAKE, 0.0)) == pytest.approx(expected, rel=1e-6)


def test_rewards_on_paper() -> None:
    logits = torch.tensor([-3.0, -1.0, 0.0, 1.0, 2.0, 5.0])
    amp = LOSSES["least_squares"].paid(logits, ZERO, None)
    torch.testing.assert_close(amp, torch.tensor([0.0, 0.0, 0.75, 1.0, 0.75, 0.0]))
    critic = LOSSES["wasserstein"].paid(logits, torch.tensor(2.0), None)
    torch.testing.assert_close(critic, torch.tensor([math.exp(min(0.0, logit - 2)) for logit in logits.tolist()]))
    for loss in LOSSES:
        assert float(LOSSES[loss].paid(logits, ZERO, 0.5).max()) == 0.5


def test_a_constant_on_all_logits_changes_nothing_for_a_critic() -> None:
    shifted = [LOSSES["wasserstein"].paid(FAKE + c, REAL.mean() + c, None) for c in (0.0, 7.0)]
    torch.testing.assert_close(*shifted)
    threshold = LOSSES["wasserstein"].threshold(REAL + 7, FAKE + 7)
    assert float(threshold) == pytest.approx(7 + (1.25 - 0.4) / 2)
    assert LOSSES["bce"].threshold(REAL, FAKE) == LOSSES["least_squares"].threshold(REAL, FAKE) == 0.0


def by_hand(network: nn.Module, points: Tensor) -> list[Tensor]:
    """Gradient of each point alone."""
    gradients = []
    for point in points:
        x = point.clone().requires_grad_()
        network(x[None]).sum().backward()
        assert x.grad is not None
        gradients.append(x.grad)
    return gradients


def test_penalties_are_those_of_gradients_taken_one_by_one() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(nn.Linear(4, 16), nn.LeakyReLU(0.2), nn.Linear(16, 1))
    real, fake, mix = torch.randn(6, 4), torch.randn(6, 4) - 1, torch.rand(6, 1)

    def logits(x: Tensor) -> Tensor:
        return torch.as_tensor(network(x).squeeze(-1))

    between = [float((g.norm() - 1) ** 2) for g in by_hand(network, mix * real + (1 - mix) * fake)]
    assert float(interpolate_penalty(logits, real, fake, mix).detach()) == pytest.approx(sum(between) / 6, rel=1e-5)
    for points in (real, torch.cat((real, fake))):
        squares = [float(g.square().sum()) for g in by_hand(network, points)]
        assert float(zero_penalty(logits, points).detach()) == pytest.approx(sum(squares) / len(points), rel=1e-5)


@pytest.mark.parametrize(("where", "expected"), [("reference", 1.0), ("both", (1 + 9) / 2)])
def test_where_the_penalty_is_taken(where: str, expected: float) -> None:
    """A discriminator of x^2 / 2 has slope x: 1 on a reference at 1, 3 on a student at 3."""
    discriminator = gaussian_discriminator(penalty_on=where)
    discriminator.network = HalfSquare()
    penalty = discriminator._penalty(torch.full((8, 1), 1.0), torch.full((8, 1), 3.0))
    assert float(penalty.detach()) == pytest.approx(expected)


def test_slopes_are_by_standard_deviations_where_features_are_standardised() -> None:
    """The teacher's deviation is 1 and its mean 0.5 whatever the unit; one discriminator is fed hundredths of it."""
    penalties = []
    for unit in (1.0, 0.01):
        reference = unit * (torch.randn((40_000, 1), generator=torch.Generator().manual_seed(0)) + 0.5)
        discriminator = gaussian_discriminator(reference=reference, standardize=True, penalty_on="both")
        penalties.append(float(discriminator._penalty(torch.full((8, 1), unit), torch.full((8, 1), 3 * unit)).detach()))
    assert penalties[0] > 0
    assert penalties[1] == pytest.approx(penalties[0], rel=1e-4)


class HalfSquare(torch.nn.Module):
    """x^2 / 2, (B, 1) -> (B, 1)."""

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        return 0.5 * inputs.square()


def gaussian_discriminator(**changes: Any) -> Discriminator:
    """A discriminator whose teacher is N(+0.5, 1)."""
    generator = torch.Generator().manual_seed(0)
    settings: dict[str, Any] = {
        "reference": torch.randn((40_000, 1), generator=generator) + 0.5,
        "hidden_sizes": [32, 32],
        "dropout": 0.0,
        "learning_rate": 3e-3,
        "penalty_weight": 0.0,
        "label_smoothing": 0.0,
        "noise": 0.0,
        "reward_limit": None,
        "held_out": 0.1,
        "patience": None,
        "standardize": False,
        "seed": 0,
    }
    return Discriminator(**(settings | changes))


def train(discriminator: Discriminator, updates: int = 250, batch: int = 1024) -> None:
    """Against a student that is N(-0.5, 1), with a rate that falls to zero."""
    generator = torch.Generator().manual_seed(1)
    rate = discriminator.optimizer.param_groups[0]["lr"]
    for update in range(updates):
        discriminator.optimizer.param_groups[0]["lr"] = rate * (1 - update / updates)
        discriminator.update(torch.randn((batch, 1), generator=generator) - 0.5)


POINTS = torch.linspace(-1.5, 1.5, 13)[:, None]
PROBABILITY = torch.sigmoid(POINTS[:, 0])  # p / (p + q), because log(p / q) = x


@pytest.mark.parametrize(
    ("loss", "smoothing", "optimum"),
    [
        ("bce", 0.0, POINTS[:, 0]),
        ("bce", 0.1, torch.logit(0.9 * PROBABILITY + 0.1 * (1 - PROBABILITY))),
        ("least_squares", 0.0, 2 * PROBABILITY - 1),
    ],
)
def test_the_best_discriminator_of_two_gaussians(loss: str, smoothing: float, optimum: Tensor) -> None:
    """D = ((1 - s) p + s q) / (p + q); least squares (p - q) / (p + q) (Goodfellow 2014, Mao 2017)."""
    discriminator = gaussian_discriminator(loss=loss, label_smoothing=smoothing)
    train(discriminator)
    discriminator.network.eval()
    with torch.no_grad():
        assert float((discriminator.logits(POINTS) - optimum).abs().max()) < 0.12


@pytest.mark.parametrize("weight", [1.0, 10.0])
def test_a_critic_of_two_gaussians_measures_their_distance(weight: float) -> None:
    """A linear critic a x minimises -a W + weight (a - 1)^2: a = 1 + W / (2 weight), with distance W = 1."""
    critic = nn.Linear(1, 1)
    nn.init.ones_(critic.weight)
    optimizer = torch.optim.Adam(critic.parameters(), lr=0.02)
    real, fake, mix = torch.tensor([[0.5]]), torch.tensor([[-0.5]]), torch.tensor([[0.5]])

    def logits(x: Tensor) -> Tensor:
        return torch.as_tensor(critic(x).squeeze(-1))

    for _ in range(300):
        optimizer.zero_grad()
        loss = LOSSES["wasserstein"].loss(logits(real), logits(fake), 0.0)
        torch.autograd.backward(loss + weight * interpolate_penalty(logits, real, fake, mix))
        optimizer.step()
    assert float(critic.weight.detach()) == pytest.approx(1 + 0.5 / weight, rel=1e-3)


def test_the_critic_pays_for_nearness_to_the_teacher() -> None:
    """Slope near one everywhere: a window d below the teacher's mean gets about exp(-d), whatever the offset."""
    discriminator = gaussian_discriminator(loss="wasserstein", penalty_weight=10.0)
    train(discriminator)
    held_out = discriminator.logits(discriminator.validation).mean()
    assert float(discriminator.level) == pytest.approx(float(held_out.detach()), rel=1e-5)
    far, near = discriminator.reward(torch.tensor([[-1.5], [-0.5]]))
    assert float(torch.log(near / far)) == pytest.approx(1.0, abs=0.2)
    assert float(discriminator.reward(discriminator.real).max()) == 1.0
    assert discriminator.update(torch.randn(2048, 1) - 0.5)["discriminator_accuracy_teacher"] > 0.6


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("where", ["interpolates", "reference", "both"])
def test_a_discriminator_goes_on_where_it_was(loss: str, where: str) -> None:
    """Bit by bit, whatever it minimises."""
    choice = {"loss": loss, "penalty_on": where, "penalty_weight": 1.0, "noise": 0.05, "dropout": 0.2}
    whole, fakes = gaussian_discriminator(**choice), torch.randn((20, 64, 1))
    for fake in fakes[:10]:
        whole.update(fake)
    state = {name: value.clone() if isinstance(value, Tensor) else value for name, value in whole.state().items()}
    state["tensors"] = {name: value.clone() for name, value in state["tensors"].items()}
    state["optimizer"] = {
        index: {name: value.clone() for name, value in entry.items()} for index, entry in state["optimizer"].items()
    }
    for fake in fakes[10:]:
        whole.update(fake)
    expected = whole.reward(POINTS)
    resumed = gaussian_discriminator(**choice)
    resumed.restore(state)
    for fake in fakes[10:]:
        resumed.update(fake)
    assert torch.equal(resumed.reward(POINTS), expected)
    assert torch.equal(resumed.best_validation, whole.best_validation)
