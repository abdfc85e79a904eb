"""What a student is paid: task and imitation, summed up over the steps of a return."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from romgrl.algorithms.replay_buffer import ReplayBuffer
from romgrl.algorithms.rom_grl import RomGrl

GAMMA, ETA, STEPS = 0.9, 0.3, 3


def learner(discriminator: Any, *, stored_reward: bool) -> RomGrl:
    """Of one environment whose step t pays t for the task and 10 t as stored imitation; it falls at every tenth."""
    buffer = ReplayBuffer(
        capacity=100, num_envs=1, observation_size=1, action_size=1, window_size=1, seed=0, n_steps=STEPS
    )
    for t in range(60):
        now, fell, still = torch.full((1, 1), float(t)), torch.tensor([float(t % 10 == 9)]), torch.zeros(1)
        buffer.add(now, now, now + 1, now[0], fell, still, now, 10 * now[0])
    sac: Any = SimpleNamespace(gamma=GAMMA)
    unused: Any = None  # the normaliser
    return RomGrl(sac, discriminator, buffer, unused, ETA, 32, 1, 32, None, stored_reward)


def test_return_of_several_steps_ends_with_a_fall() -> None:
    judge = SimpleNamespace(reward=lambda windows: 5 + windows[:, 0])
    for discriminator, stored in ((None, False), (judge, False), (judge, True)):
        made = learner(discriminator, stored_reward=stored)
        drawn = made.buffer.sample(500)
        paid, _ = made._reward(drawn)
        for start, found in zip(drawn.observation[:, 0].tolist(), paid.tolist(), strict=True):
            times = [t for t in range(int(start), int(start) + STEPS) if t // 10 == int(start) // 10 and t < 60]
            imitation = [0.0 if discriminator is None else 10 * t if stored else 5 + t for t in times]
            weight = 0.0 if discriminator is None else 1 - ETA
            rewards = [ETA * t + weight * r for t, r in zip(times, imitation, strict=True)]
            assert found == pytest.approx(sum(GAMMA**k * r for k, r in enumerate(rewards)), rel=1e-5, abs=1e-5)
