"""Advantages and returns against numbers worked out by hand or in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from romgrl.algorithms.rollout_buffer import compute_gae
from tests.algorithms.small_ppo import filled_rollout, make_ppo, networks

NEVER = torch.zeros(3, 1, dtype=torch.bool)


def at(step: int) -> torch.Tensor:
    flags = NEVER.clone()
    flags[step] = True
    return flags


def column(*values: float) -> torch.Tensor:
    return torch.tensor(values)[:, None]


# Rewards 1, 2, 3; values 0.5, 1, 1.5; gamma 0.5, lambda 0.5.
# Without an end: deltas 1 + 0.5 * 1 - 0.5 = 1, 2 + 0.5 * 1.5 - 1 = 1.75, 3 + 0.5 * 4 - 1.5 = 3.5;
# advantages 3.5, 1.75 + 0.25 * 3.5 = 2.625, 1 + 0.25 * 2.625 = 1.65625.
# Ending at step 1 by termination: delta 2 - 1 = 1; advantages 3.5, 1, 1 + 0.25 = 1.25.
# Ending at step 1 by truncation, the final observation worth 10: delta 2 + 5 - 1 = 6; advantages 3.5, 6, 1 + 1.5 = 2.5.
@pytest.mark.parametrize(
    ("terminated", "truncated", "next_at_one", "expected"),
    [
        (NEVER, NEVER, 1.5, (1.65625, 2.625, 3.5)),
        (at(1), NEVER, 10.0, (1.25, 1.0, 3.5)),
        (NEVER, at(1), 10.0, (2.5, 6.0, 3.5)),
        (at(1), at(1), 10.0, (1.25, 1.0, 3.5)),
    ],
    ids=["running", "terminated", "truncated", "both"],
)
def test_gae_by_hand(
    terminated: torch.Tensor, truncated: torch.Tensor, next_at_one: float, expected: tuple[float, ...]
) -> None:
    values = column(0.5, 1.0, 1.5)
    advantages, returns = compute_gae(
        column(1.0, 2.0, 3.0), values, column(1.0, next_at_one, 4.0), terminated, truncated, 0.5, 0.5
    )
    torch.testing.assert_close(advantages, column(*expected), rtol=0, atol=1e-6)
    torch.testing.assert_close(returns, column(*expected) + values, rtol=0, atol=1e-6)


def test_gae_with_lambda_one_is_the_discounted_return() -> None:
    rewards, values = np.array([0.3, -1.0, 2.0, 0.7]), np.array([1.0, 0.4, -0.2, 0.9])
    last = 5.0
    expected = [sum(0.9**k * r for k, r in enumerate(rewards[i:])) + 0.9 ** (4 - i) * last for i in range(4)]
    flags = torch.zeros(4, 1, dtype=torch.bool)
    _, returns = compute_gae(
        column(*rewards), column(*values), column(*values[1:], last), flags, flags.clone(), 0.9, 1.0
    )
    np.testing.assert_allclose(returns[:, 0].numpy(), expected, atol=1e-5)


def test_truncated_step_bootstraps_from_the_final_observation() -> None:
    ppo = make_ppo()
    rollout = filled_rollout()
    rollout.truncated[3, 1] = True
    rollout.terminated[5, 2] = True
    values = networks(ppo, ppo.weights, rollout.observations)[-1].numpy()
    final = networks(ppo, ppo.weights, rollout.next_observations)[-1].numpy()
    _, returns, _ = ppo._advantages(rollout)
    rewards = rollout.rewards.numpy()
    assert returns[3, 1].item() == pytest.approx(rewards[3, 1] + 0.9 * final[3, 1], abs=1e-5)
    assert returns[5, 2].item() == pytest.approx(rewards[5, 2], abs=1e-5)
    assert returns[7, 0].item() == pytest.approx(rewards[7, 0] + 0.9 * final[7, 0], abs=1e-5)
    following = rewards[6, 0] + 0.9 * (0.2 * values[7, 0] + 0.8 * returns[7, 0].item())
    assert returns[6, 0].item() == pytest.approx(following, abs=1e-5)
