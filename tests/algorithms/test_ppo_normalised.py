"""What Sample Factory's PPO does beyond the default: normalised observations and returns, clipped values, segments."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
import torch

from romgrl.algorithms.networks.running_normalizer import RunningNormalizer
from romgrl.algorithms.ppo import PPO, Minibatch
from romgrl.algorithms.ppo_policy import LIMIT, OBSERVATION_MOMENTS, PPOPolicy, load_ppo_policy, save_ppo_policy
from romgrl.algorithms.rollout_buffer import Rollout, compute_gae
from romgrl.artifacts import load_tensors, save_tensors
from romgrl.errors import ArtifactError
from tests.algorithms.small_ppo import filled_rollout, make_ppo

NORMALISED = {"normalize_observation": True, "normalize_return": True}


def test_normaliser_by_hand() -> None:
    """1 and 3: mean 2, deviation 1; 9 lies 7 deviations above, of which 5 count."""
    normaliser = RunningNormalizer(1, limit=5.0)
    normaliser.update(torch.tensor([[1.0], [3.0]]))
    torch.testing.assert_close(normaliser.apply_(torch.tensor([[3.0], [9.0], [-9.0]])), column(1.0, 5.0, -5.0))
    torch.testing.assert_close(normaliser.undo(column(1.0, 7.0, -0.5)), column(3.0, 7.0, 1.5))
    unlimited = RunningNormalizer(1)
    unlimited.use(torch.tensor([2.0]), torch.tensor([0.5]))
    torch.testing.assert_close(unlimited.apply_(column(12.0)), column(5.0))
    torch.testing.assert_close(unlimited.undo(column(7.0)), column(16.0))
    off = RunningNormalizer(1, enabled=False, limit=5.0)
    off.update(column(1.0, 3.0))
    assert torch.equal(off.undo(off.apply_(column(9.0))), column(9.0))


def column(*values: float) -> torch.Tensor:
    return torch.tensor(values)[:, None]


def constant_value(ppo: PPO, value: float) -> None:
    """Let the value network give one number whatever it sees."""
    ppo.value.flat.zero_()
    ppo.value.biases[-1].fill_(value)


# The network gives V = 3; clip 1. With the old value 0 the clipped one is 1:
# return 2: errors 1 and -1, as large: counts, 1; return 0: 3 is larger than 1: 3; return 5: 4 is larger than 2: 0.
# With the old value 2.5 the clip is not reached: -2 for a return of 5. Mean 0.5, times the coefficient 0.5: 0.25.
@pytest.mark.parametrize(("clip", "expected"), [(1.0, 0.25), (None, 0.5 * (1 + 3 - 2 - 2) / 4)])
def test_value_clip_by_hand(clip: float | None, expected: float) -> None:
    ppo = make_ppo(value_clip=clip)
    constant_value(ppo, 3.0)
    returns, old = torch.tensor([2.0, 0.0, 5.0, 5.0]), torch.tensor([0.0, 0.0, 0.0, 2.5])
    nothing = torch.zeros(4)
    minibatch = Minibatch(torch.zeros(4, 3), torch.zeros(4, 2), nothing, nothing, returns, old)
    torch.testing.assert_close(ppo.value_gradient(minibatch), 3.0 - returns)
    assert ppo.value.bias_gradients[-1].item() == pytest.approx(expected)


def test_value_clip_is_the_larger_of_both_losses() -> None:
    """Against automatic differentiation of max((V - R)^2, (V' + clip(V - V') - R)^2) / 2."""
    ppo = make_ppo(value_clip=0.3, hidden_sizes=[])
    drawn = torch.Generator().manual_seed(2)
    observations, returns, old = (torch.randn(*size, generator=drawn) for size in ((64, 3), (64,), (64,)))
    minibatch = Minibatch(observations, torch.zeros(64, 2), returns, returns, returns, old)
    ppo.value_gradient(minibatch)
    weight = ppo.value.weights[0][0].clone().requires_grad_()
    value = (observations @ weight)[:, 0] + ppo.value.biases[0].item()
    clipped = old + (value - old).clamp(-0.3, 0.3)
    loss = 0.5 * torch.maximum((value - returns).square(), (clipped - returns).square()).mean()
    (expected,) = torch.autograd.grad(0.5 * loss, weight)
    torch.testing.assert_close(ppo.value.weight_gradients[0][0], expected)


def test_a_segment_ends_in_a_value() -> None:
    """Rewards 1, 2, 3, values 0.5, 1, 1.5, then 4; gamma and lambda 0.5: deltas 1, 1.75, 3.5, as in test_advantages.

    Segments of two steps: 1 + 0.25 x 1.75 = 1.4375, then 1.75 and 3.5 by themselves.
    """
    never = torch.zeros(3, 1, dtype=torch.bool)
    given = (column(1.0, 2.0, 3.0), column(0.5, 1.0, 1.5), column(1.0, 1.5, 4.0), never, never, 0.5, 0.5)
    torch.testing.assert_close(compute_gae(*given, 2)[0], column(1.4375, 1.75, 3.5))
    torch.testing.assert_close(compute_gae(*given, 1)[0], column(1.0, 1.75, 3.5))
    for whole in (3, 100, None):
        torch.testing.assert_close(compute_gae(*given, whole)[0], column(1.65625, 2.625, 3.5))


@pytest.mark.parametrize(("bootstrap", "expected"), [(True, 2.0 + 0.9 * 7.0), (False, 2.0)])
def test_what_follows_the_end_of_time(bootstrap: bool, expected: float) -> None:
    """A reward of 2 in the step that is cut off, all values 7, gamma 0.9."""
    ppo = make_ppo(bootstrap_truncated=bootstrap)
    constant_value(ppo, 7.0)
    rollout = filled_rollout()
    rollout.rewards.fill_(2.0)
    rollout.truncated[3, 1] = True
    _, returns, _ = ppo._advantages(rollout)
    assert returns[3, 1].item() == pytest.approx(expected)
    assert returns[7, 1].item() == pytest.approx(2.0 + 0.9 * 7.0)  # the rollout ends, not the time


def test_values_are_undone_by_hand() -> None:
    """Returns 8 and 12 so far: mean 10, deviation 2. The network's 0.5 is a value of 11: 1 + 0.9 x 11 - 11 = -0.1."""
    ppo = make_ppo(normalize_return=True)
    ppo.returns.update(column(8.0, 12.0))
    constant_value(ppo, 0.5)
    rollout = Rollout(steps=1, num_envs=1, observation_size=3, action_size=2)
    rollout.rewards.fill_(1.0)
    advantages, returns, given = ppo._advantages(rollout)
    assert [float(found) for found in (advantages, returns, given)] == pytest.approx([-0.1, 10.9, 0.5], abs=1e-5)


def test_learning_sees_normalised_samples_and_leaves_the_rollout_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    ppo, rollout, seen = make_ppo(**NORMALISED, epochs=1, minibatch_size=32), filled_rollout(), []
    rollout.observations.mul_(3.0).add_(20.0)
    before = rollout.observations.clone()
    value_gradient = ppo.value_gradient

    def spy(minibatch: Minibatch) -> torch.Tensor:
        seen.append(minibatch)
        return value_gradient(minibatch)

    monkeypatch.setattr(ppo, "value_gradient", spy)
    ppo.update(rollout)
    assert torch.equal(rollout.observations, before)
    for samples in (seen[0].observations, seen[0].returns[:, None]):
        torch.testing.assert_close(samples.mean(0), torch.zeros(samples.shape[1]), rtol=0, atol=1e-5)
        torch.testing.assert_close(samples.std(0, correction=0), torch.ones(samples.shape[1]), rtol=0, atol=1e-5)


def test_exploration_and_mean_action_see_the_same() -> None:
    ppo = make_ppo(**NORMALISED, policy_gain=1.0, initial_log_std=-20.0)
    rollout = filled_rollout()
    ppo.update(rollout)
    observation = 4.0 * torch.randn(50, 3, generator=torch.Generator().manual_seed(5))
    action = ppo.act(observation)[0].clamp(-1.0, 1.0)
    mean_action = torch.from_numpy(ppo.mean_policy()(observation.numpy()))
    torch.testing.assert_close(action, mean_action, rtol=0, atol=1e-5)
    assert not torch.allclose(mean_action, torch.from_numpy(plain(ppo)(observation.numpy())), atol=1e-3)


def plain(ppo: PPO) -> PPOPolicy:
    """The same network without its normaliser."""
    policy = ppo.mean_policy()
    policy.moments = None
    return policy


def test_the_normaliser_is_part_of_the_file(tmp_path: Path) -> None:
    ppo, path = make_ppo(**NORMALISED, policy_gain=1.0), tmp_path / "policy.safetensors"
    ppo.update(filled_rollout())
    save_ppo_policy(path, ppo)
    observation = 9.0 * np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    np.testing.assert_array_equal(load_ppo_policy(path)(observation), ppo.mean_policy()(observation))
    mean, scale = ppo.observations.mean_and_scale()
    limited = ((torch.from_numpy(observation) - mean) * scale).clamp(-LIMIT, LIMIT)
    network = load_ppo_policy(path).network
    expected = network.forward(limited, network.tape(40))[0].clamp(-1.0, 1.0).numpy()
    np.testing.assert_array_equal(load_ppo_policy(path)(observation), expected)
    tensors, metadata = load_tensors(path)
    assert set(OBSERVATION_MOMENTS) <= tensors.keys()
    del tensors[OBSERVATION_MOMENTS[1]]
    save_tensors(path, tensors, metadata)
    with pytest.raises(ArtifactError, match="no tensor observation_scale"):
        load_ppo_policy(path)
    save_ppo_policy(path, make_ppo())
    assert set(OBSERVATION_MOMENTS).isdisjoint(load_tensors(path)[0])


@pytest.mark.parametrize("normalised", [False, True])
def test_a_kept_policy_comes_back_with_its_normaliser(normalised: bool) -> None:
    ppo = make_ppo(normalize_observation=normalised, policy_gain=1.0)
    ppo.update(filled_rollout())
    kept, observation = ppo.policy_vector(), np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    before = ppo.mean_policy()(observation)
    assert len(kept) == len(ppo.policy.flat) + 6 * normalised
    for seed in range(3):
        ppo.update(filled_rollout(seed))
    assert not np.array_equal(ppo.mean_policy()(observation), before)
    ppo.put_policy_vector(kept)
    np.testing.assert_array_equal(ppo.mean_policy()(observation), before)


def test_a_restored_learner_goes_on_with_its_normalisers() -> None:
    first, second = make_ppo(**NORMALISED, value_clip=1.0), make_ppo(**NORMALISED, value_clip=1.0, seed=1)
    first.update(filled_rollout())
    second.restore(copy.deepcopy(first.state()))
    losses = [ppo.update(filled_rollout(1)) for ppo in (first, second)]
    assert losses[0] == losses[1]
    assert torch.equal(first.weights, second.weights)


def test_first_weights_and_the_optimiser() -> None:
    """Orthogonal matrices times a gain have that gain as all their singular values."""
    ppo = make_ppo(hidden_gain=3.0, policy_gain=0.5, adam_epsilon=1e-6)
    for network, last in ((ppo.policy, 0.5), (ppo.value, 1.0)):
        *hidden, output = (torch.linalg.svdvals(weight[0]) for weight in network.weights)
        torch.testing.assert_close(torch.cat(hidden), torch.full((3 + 16,), 3.0))
        torch.testing.assert_close(output, torch.full_like(output, last))
    assert [group["eps"] for group in ppo.optimizer.param_groups] == [1e-6]
