"""Tanh-squashed Gaussian: actions, their density, and the gradients through both (Haarnoja et al. 2018, app. C).

With the head's outputs m and l, noise n ~ N(0, 1):
    log s = LOG_STD_MIN + (LOG_STD_MAX - LOG_STD_MIN) (tanh l + 1) / 2,  u = m + s n,  a = tanh u,
    log pi(a) = sum over the actions of  -n^2 / 2 - log s - log(2 pi) / 2 - log(1 - a^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

LOG_STD_MIN, LOG_STD_MAX = -5.0, 2.0
HALF_RANGE = 0.5 * (LOG_STD_MAX - LOG_STD_MIN)
STARTING_SLOPE = 0.1
"""Of the weights that a head has for the deviations, which then hardly depend on what is observed."""


@dataclass
class Sample:
    """Actions drawn for B observations, and what the gradient needs."""

    action: Tensor  # (B, A) in [-1, 1]
    log_probability: Tensor  # (B,)
    noise: Tensor  # (B, A)
    deviation: Tensor  # (B, A), s
    squashed: Tensor  # (B, A), tanh l


def log_density(noise: Tensor, log_std: Tensor, pre_tanh: Tensor) -> Tensor:
    """log pi(tanh u), (B,), from (B, A) each; log(1 - tanh^2 u) in its stable form."""
    gaussian = -0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)
    squash = 2.0 * (math.log(2.0) - pre_tanh - F.softplus(-2.0 * pre_tanh))
    return (gaussian - squash).sum(-1)


def sample(head: Tensor, noise: Tensor) -> Sample:
    """Actions for the head's outputs (B, 2 A) and noise (B, A)."""
    mean, raw = head.chunk(2, -1)
    squashed = torch.tanh(raw)
    log_std = HALF_RANGE * squashed + (LOG_STD_MIN + HALF_RANGE)
    deviation = log_std.exp()
    pre_tanh = torch.addcmul(mean, deviation, noise)
    return Sample(torch.tanh(pre_tanh), log_density(noise, log_std, pre_tanh), noise, deviation, squashed)


def start_at(weight: Tensor, bias: Tensor, log_std: float) -> None:
    """Let a head, weight (S, I, 2 A) and bias (S, 1, 2 A), begin near one log standard deviation for all actions."""
    actions = slice(bias.shape[-1] // 2, None)
    bias[..., actions] = math.atanh((log_std - LOG_STD_MIN) / HALF_RANGE - 1)
    weight[..., actions] *= STARTING_SLOPE


def head_gradient(sample: Sample, by_action: Tensor, by_log_probability: Tensor) -> Tensor:
    """d loss / d head (B, 2 A) from d loss / d action (B, A) and d loss / d log pi, a number or (B, 1).

    d log pi / d u = 2 a, d a / d u = 1 - a^2, d log pi / d log s = -1 at a fixed u.
    """
    action = sample.action
    by_mean = torch.addcmul(by_action, by_action, action.square(), value=-1).addcmul_(action, 2 * by_log_probability)
    by_log_std = by_mean * sample.deviation * sample.noise - by_log_probability
    by_raw = HALF_RANGE * by_log_std * (1 - sample.squashed.square())
    return torch.cat((by_mean, by_raw), -1)
