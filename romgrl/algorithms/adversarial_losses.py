"""What the discriminator minimises and what it pays: three losses with their rewards, and gradient penalties.

A logit is the discriminator's output without any squashing, whatever the loss; high is the teacher's. Real windows are
the teacher's, fake ones the student's.

| loss          | real stream            | fake stream            | imitation reward of a logit l           |
| bce           | labels 1 - smoothing   | labels smoothing       | -log(1 - D) = softplus(l)               |
| least_squares | (l - 1)^2              | (l + 1)^2              | max(0, 1 - (l - 1)^2 / 4), in [0, 1]    |
| wasserstein   | -l                     | +l                     | exp(min(0, l - level)), in (0, 1]       |

bce: Ho and Ermon (2016) and the paper's section 3.3. least_squares: Peng et al. (2021), AMP, equations 6 and 7.
wasserstein: Gulrajani et al. (2017). Its critic is known up to a constant, so the reward is measured from `level`, its
mean over the held-out windows of the teacher: one where the critic sees the teacher, and e^-d at d critic units below,
which are standardised feature units times the slope that the gradient penalty allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

Logits = Callable[[Tensor], Tensor]


def cross_entropy(logits: Tensor, label: float) -> Tensor:
    """Binary cross-entropy of logits whose labels are all the same."""
    return F.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))


@dataclass(frozen=True)
class AdversarialLoss:
    """A loss of the discriminator and what goes with it; another one is a record more in LOSSES.

    `real` and `fake`: the terms of both streams, of logits (B,) and the label smoothing; `reward` (B,) of logits and
    `level`, the mean logit of held-out windows of the teacher. `relative`: logits are known up to a constant, so that
    only differences count. `undecided`: what the loss of a discriminator that tells nothing apart is measured by; None:
    that of zeros.
    """

    real: Callable[[Tensor, float], Tensor]
    fake: Callable[[Tensor, float], Tensor]
    reward: Callable[[Tensor, Tensor], Tensor]
    relative: bool = False
    undecided: float | None = None

    def loss(self, real_logits: Tensor, fake_logits: Tensor, label_smoothing: float) -> Tensor:
        """What is minimised: both terms, summed as in the paper's L_D."""
        return self.real(real_logits, label_smoothing) + self.fake(fake_logits, label_smoothing)

    def paid(self, logits: Tensor, level: Tensor, limit: float | None) -> Tensor:
        """The reward, at most `limit`."""
        reward = self.reward(logits, level)
        return reward.clamp(max=limit) if limit is not None else reward

    def threshold(self, real_logits: Tensor, fake_logits: Tensor) -> Tensor | float:
        """The logit above which a window counts as the teacher's: midway where zero means nothing."""
        return 0.5 * (real_logits.mean() + fake_logits.mean()) if self.relative else 0.0

    def undecided_loss(self, label_smoothing: float) -> float:
        """What the loss of a discriminator that tells nothing apart is measured by."""
        nothing = torch.zeros(1)
        return float(self.loss(nothing, nothing, label_smoothing)) if self.undecided is None else self.undecided


LOSSES = {
    "bce": AdversarialLoss(
        lambda logits, smoothing: cross_entropy(logits, 1 - smoothing),
        lambda logits, smoothing: cross_entropy(logits, smoothing),
        lambda logits, level: F.softplus(logits),
    ),
    "least_squares": AdversarialLoss(
        lambda logits, smoothing: (logits - 1).square().mean(),
        lambda logits, smoothing: (logits + 1).square().mean(),
        lambda logits, level: (1 - 0.25 * (logits - 1).square()).clamp(min=0),
    ),
    "wasserstein": AdversarialLoss(
        lambda logits, smoothing: -logits.mean(),
        lambda logits, smoothing: logits.mean(),
        lambda logits, level: (logits - level).clamp(max=0).exp(),
        relative=True,
        undecided=1.0,
    ),
}
"""By the value of `discriminator.loss`, whose choices stand in romgrl.config.learners."""


def interpolate_penalty(logits: Logits, real: Tensor, fake: Tensor, mix: Tensor) -> Tensor:
    """E (|grad_x logit(x)| - 1)^2 on x = mix real + (1 - mix) fake (WGAN-GP); mix is (B, 1) in [0, 1]."""
    gradient = slope(logits, mix * real + (1 - mix) * fake)
    penalty: Tensor = (gradient.norm(dim=-1) - 1).square().mean()
    return penalty


def zero_penalty(logits: Logits, points: Tensor) -> Tensor:
    """E |grad_x logit(x)|^2 on `points` (B, F): R1 on the teacher's (AMP), R1 and R2 on both streams (Mescheder 2018).

    AMP weighs it by w / 2, here the whole weight stands before it.
    """
    penalty: Tensor = slope(logits, points).square().sum(-1).mean()
    return penalty


def slope(logits: Logits, points: Tensor) -> Tensor:
    """Gradient (B, F) of the logits by their inputs, itself differentiable."""
    points = points.detach().requires_grad_()
    (gradient,) = torch.autograd.grad(logits(points).sum(), points, create_graph=True)
    return gradient
