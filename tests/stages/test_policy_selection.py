"""Which policy of a training is kept."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import torch

from romgrl.algorithms.sac import SAC, load_sac_policy
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.training import policy_selection
from romgrl.stages.training.budget import Budget
from romgrl.stages.training.policy_selection import Candidates
from tests.conftest import Composer

BASELINE = ("experiment=smoke", "discriminator=none", "eta=1", "student.total_steps=1600", "student.candidates=4")


class Learner:
    """Stands for an agent whose weights are its number of steps."""

    def __init__(self, step: float) -> None:
        self.sac, self.normalizer = self, self
        self.average = self
        self.flat = torch.full((3,), step)

    def mean_and_scale(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self.flat.clone(), -self.flat


def test_candidates_are_evenly_spaced_over_the_second_half() -> None:
    candidates, budget = Candidates(count=5), Budget(100)
    for step in range(3, 103, 3):
        candidates.keep(step, budget, Learner(step))  # type: ignore[arg-type]
    assert candidates.steps == [60, 72, 81, 90, 102]
    assert [float(weights[0]) for weights in candidates.weights] == [60, 72, 81, 90, 102]


def test_a_resumed_training_has_the_same_candidates() -> None:
    whole, first, second = (Candidates(count=5) for _ in range(3))
    budget = Budget(100)
    second.restore(first.state())  # before there is any
    for step in range(5, 105, 5):
        whole.keep(step, budget, Learner(step))  # type: ignore[arg-type]
        if step == 80:
            second.restore(first.state())
        (first if step <= 75 else second).keep(step, budget, Learner(step))  # type: ignore[arg-type]
    assert second.steps == whole.steps
    for name, values in whole.state().items():
        assert torch.equal(torch.as_tensor(second.state()[name]), torch.as_tensor(values))


@pytest.mark.parametrize("best", [0, 2, 3])
def test_the_one_that_earns_most_is_kept(
    best: int, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file has its weights and its moments, selection.csv what each earned."""
    rewards = [0.1, 0.1, 0.1, 0.1]
    rewards[best] = 0.2
    calls = iter(rewards)
    kept: list[Candidates] = []
    choose = student.choose

    def spy(config: Any, learner: Any, candidates: Candidates, *rest: Any) -> Any:
        kept.append(candidates)
        return choose(config, learner, candidates, *rest)

    monkeypatch.setattr(student, "choose", spy)
    monkeypatch.setattr(policy_selection, "earned", lambda *_, **__: {"reward": next(calls), "upright_share": 1.0})
    student.run(compose_config(*BASELINE), {}, tmp_path, SilentLog())
    (candidates,) = kept
    policy = load_sac_policy(tmp_path / "policy.safetensors")
    assert torch.equal(policy.policy.flat, candidates.weights[best])
    assert torch.equal(policy.mean, candidates.moments[best][0])
    assert not torch.equal(candidates.weights[best], candidates.weights[best - 1])
    table = pd.read_csv(tmp_path / policy_selection.FILE)
    assert table.step.tolist() == [1000, 1200, 1400, 1600]
    assert table.reward.tolist() == rewards


def test_reward_counts_until_the_first_fall(compose_config: Composer, monkeypatch: pytest.MonkeyPatch) -> None:
    """An untrained policy falls; with everything upright each step would pay 1."""
    config = compose_config(*BASELINE)
    env = policy_selection.humanoid_env(config, num_envs=4, episode_steps=301)
    learner = student.build_student_learner(config, env, student.window_layout(config), None)
    monkeypatch.setattr(type(env.task), "reward", lambda *_: 1.0 + 0 * _[1])
    network = policy_selection.StackedMLP(stack=1, **learner.sac.network)
    network.flat.copy_(learner.sac.average.flat)
    policy = policy_selection.SACPolicy(network, torch.arange(358), torch.zeros(358), torch.ones(358))
    earned = policy_selection.earned(env, policy, learner, student.window_layout(config), seed=0)
    assert isinstance(learner.sac, SAC)
    assert earned["upright_share"] == 0.0
    assert 0.005 < earned["reward"] < 0.5
