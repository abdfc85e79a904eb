"""The formula of the operations per update, against PyTorch's counter."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from benchmarks import flops
from benchmarks.setup import PLAIN_SAC, Student, configuration, in_student_stage

SIZES = {"observation": 30, "action": 4, "hidden": [16, 24], "batch": 8}


def network(*sizes: int) -> nn.Sequential:
    layers = [nn.Linear(i, o) for i, o in pairwise(sizes)]
    return nn.Sequential(*layers)


def plain_update(observation: int, action: int, hidden: list[int], batch: int) -> int:
    """Operations of SAC's losses as the paper prints them, counted while automatic differentiation runs."""
    policy = network(observation, *hidden, 2 * action)
    critics, targets = ([network(observation + action, *hidden, 1) for _ in range(2)] for _ in range(2))
    state, act = torch.randn(batch, observation), torch.randn(batch, action)
    counter = FlopCounterMode(display=False)
    with counter:
        with torch.no_grad():
            next_input = torch.cat((state, policy(state)[:, :action]), 1)
            target = torch.minimum(*(critic(next_input) for critic in targets))
        sum((critic(torch.cat((state, act), 1)) - target).square().mean() for critic in critics).backward()
        for critic in critics:
            critic.requires_grad_(False)
        chosen = torch.cat((state, policy(state)[:, :action]), 1)
        (-torch.minimum(*(critic(chosen) for critic in critics)).mean()).backward()
    return counter.get_total_flops()


def test_textbook_count_is_what_autograd_does() -> None:
    assert flops.total(flops.textbook(**SIZES, policy_delay=1)) == plain_update(**SIZES)


def test_useful_count_leaves_out_the_gradient_of_the_observation() -> None:
    saved = flops.total(flops.textbook(**SIZES, policy_delay=2)) - flops.total(flops.useful(**SIZES, policy_delay=2))
    assert saved == 2 * 8 * 30 * 16 * 2 / 2  # 2 B n m for two critics at every second update


@pytest.mark.parametrize("delay", [1, 2])
def test_real_update_does_at_least_what_is_useful_and_at_most_the_textbook(delay: int) -> None:
    sizes = {"hidden": [32, 32], "batch": 64}
    small = ("student.hidden_sizes=[32,32]", "student.batch_size=64", f"student.policy_delay={delay}")
    config = configuration(*PLAIN_SAC, "student.learning_starts=320", *small, threads=1)

    def count(student: Student) -> int:
        student.fill()
        with FlopCounterMode(display=False) as counter:
            student.updates(2)()
        return counter.get_total_flops()

    counted = in_student_stage(count, config)
    useful, textbook = (
        formula(observation=358, action=21, **sizes, policy_delay=delay) for formula in (flops.useful, flops.textbook)
    )
    matrices = [each for each in useful if min(each.rows, each.inner, each.columns) > 1]  # vectors need no product
    assert 2 * flops.total(matrices) <= counted <= 2 * flops.total(textbook)
