"""PPO against numbers worked out by hand or in plain numpy."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from romgrl.algorithms.ppo import (
    PPO,
    Minibatch,
    clipped_policy_loss,
    gaussian_log_probability,
    load_ppo_policy,
    save_ppo_policy,
)
from romgrl.algorithms.rollout_buffer import Rollout, compute_gae
from romgrl.algorithms.second_thread import second_lane
from romgrl.artifacts import load_tensors
from romgrl.errors import ArtifactError
from romgrl.gait.symmetry import Mirror, unsigned
from tests.helpers.automatic_gradients import forward_by_autograd

NEVER = torch.zeros(3, 1, dtype=torch.bool)


def at(step: int) -> torch.Tensor:
    flags = NEVER.clone()
    flags[step] = True
    return flags


def column(*values: float) -> torch.Tensor:
    return torch.tensor(values)[:, None]


def make_ppo(**changes: Any) -> PPO:
    settings: dict[str, Any] = {
        "observation_size": 3,
        "action_size": 2,
        "hidden_sizes": [16, 16],
        "activation": "tanh",
        "learning_rate": 1e-3,
        "gamma": 0.9,
        "gae_lambda": 0.8,
        "clip_ratio": 0.2,
        "epochs": 2,
        "minibatch_size": 16,
        "value_coefficient": 0.5,
        "entropy_coefficient": 0.0,
        "max_gradient_norm": 0.5,
        "initial_log_std": -0.5,
    }
    return PPO(**(settings | changes))


def filled_rollout(seed: int = 0) -> Rollout:
    generator = torch.Generator().manual_seed(seed)
    rollout = Rollout(steps=8, num_envs=4, observation_size=3, action_size=2)
    for tensor in (rollout.observations, rollout.next_observations, rollout.actions, rollout.rewards):
        tensor.normal_(generator=generator)
    return rollout


def networks(ppo: PPO, weights: torch.Tensor, observations: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Means and log standard deviation of the actions, and values, differentiable by the learner's `weights`."""
    activation = str(ppo.spec["activation"])
    policy, value, log_std = weights.split([len(ppo.policy.flat), len(ppo.value.flat), len(ppo.log_std)])
    flat = observations.flatten(0, -2)
    mean = forward_by_autograd(ppo.policy, activation, policy, flat).view(*observations.shape[:-1], -1)
    return mean, log_std, forward_by_autograd(ppo.value, activation, value, flat).view(observations.shape[:-1])


def normal(mean: torch.Tensor, log_std: torch.Tensor) -> torch.distributions.Independent:
    return torch.distributions.Independent(torch.distributions.Normal(mean, log_std.exp()), 1)


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
    _, returns = ppo._advantages(rollout)
    rewards = rollout.rewards.numpy()
    assert returns[3, 1].item() == pytest.approx(rewards[3, 1] + 0.9 * final[3, 1], abs=1e-5)
    assert returns[5, 2].item() == pytest.approx(rewards[5, 2], abs=1e-5)
    assert returns[7, 0].item() == pytest.approx(rewards[7, 0] + 0.9 * final[7, 0], abs=1e-5)
    following = rewards[6, 0] + 0.9 * (0.2 * values[7, 0] + 0.8 * returns[7, 0].item())
    assert returns[6, 0].item() == pytest.approx(following, abs=1e-5)


def test_clipped_loss_by_hand() -> None:
    # Ratios 1.5, 0.5, 1.5, 0.5, 1.1 with advantages 1, 1, -1, -1, 2 and clip 0.2:
    # min(1.5, 1.2) = 1.2, min(0.5, 0.8) = 0.5, min(-1.5, -1.2) = -1.5, min(-0.5, -0.8) = -0.8, 2.2; mean 0.32.
    ratios = torch.tensor([1.5, 0.5, 1.5, 0.5, 1.1])
    assert clipped_policy_loss(ratios.log(), torch.tensor([1.0, 1.0, -1.0, -1.0, 2.0]), 0.2).item() == pytest.approx(
        -0.32, abs=1e-6
    )


def test_clipped_loss_stops_the_gradient_beyond_the_clip() -> None:
    log_ratio = torch.tensor([1.5, 0.5, 1.5, 0.5]).log().requires_grad_()
    clipped_policy_loss(log_ratio, torch.tensor([1.0, 1.0, -1.0, -1.0]), 0.2).backward()
    # d/d(log r) of -r A / 4 where the minimum is not clipped: r = 0.5, A = 1 and r = 1.5, A = -1.
    assert log_ratio.grad is not None
    torch.testing.assert_close(log_ratio.grad, torch.tensor([0.0, -0.125, 0.375, 0.0]))


def test_gaussian_density() -> None:
    # N(0.5; 0, 2) x N(-1; 1, 0.5): exponents -0.03125 and -8, sum of log std 0, log(2 pi) once for two halves.
    log_std = torch.tensor([math.log(2.0), math.log(0.5)])
    scaled = (torch.tensor([[0.5, -1.0]]) - torch.tensor([[0.0, 1.0]])) / log_std.exp()
    density = gaussian_log_probability(scaled, log_std)
    assert density.item() == pytest.approx(-8.03125 - math.log(2 * math.pi), abs=1e-6)


def test_act_returns_the_density_of_its_own_action() -> None:
    ppo = make_ppo()
    observation = torch.randn(5, 3, generator=torch.Generator().manual_seed(1))
    action, log_probability = ppo.act(observation)
    mean, log_std, _ = networks(ppo, ppo.weights, observation)
    torch.testing.assert_close(log_probability, normal(mean, log_std).log_prob(action))


def test_half_of_each_minibatch_is_mirrored(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = Mirror(np.array([1, 0, 2]), np.array([1.0, 1.0, -1.0], np.float32))
    ppo = make_ppo(epochs=1, minibatch_size=32, mirror_observation=pair, mirror_action=pair.kept(np.arange(2)))
    rollout = filled_rollout()
    seen: list[torch.Tensor] = []
    value_gradient = ppo.value_gradient

    def spy(minibatch: Minibatch) -> torch.Tensor:
        seen.append(minibatch.observations.clone())
        return value_gradient(minibatch)

    monkeypatch.setattr(ppo, "value_gradient", spy)
    ppo.update(rollout)
    (trained,) = seen
    originals = rollout.observations.flatten(0, 1)
    images = originals[:, [1, 0, 2]] * torch.tensor([1.0, 1.0, -1.0])
    assert [int((row == images).all(1).sum()) for row in trained[:16]] == [1] * 16
    assert [int((row == originals).all(1).sum()) for row in trained[16:]] == [1] * 16


def test_mirroring_needs_both_pairs() -> None:
    with pytest.raises(ValueError, match="together"):
        make_ppo(mirror_observation=unsigned(np.arange(3)))


def test_update_leaves_the_rollout_alone_and_is_finite() -> None:
    pair = unsigned([1, 0, 2])
    ppo = make_ppo(mirror_observation=pair, mirror_action=pair.kept(np.arange(2)))
    rollout = filled_rollout()
    before = rollout.observations.clone(), rollout.actions.clone()
    losses = ppo.update(rollout)
    assert torch.equal(rollout.observations, before[0])
    assert torch.equal(rollout.actions, before[1])
    assert all(math.isfinite(value) for value in losses.values())
    assert losses["action_std"] == pytest.approx(math.exp(-0.5), abs=0.02)


def test_mirrored_samples_keep_the_rest_of_their_row() -> None:
    pair = Mirror(np.array([1, 0, 2]), np.array([1.0, 1.0, -1.0], np.float32))
    ppo = make_ppo(minibatch_size=8, mirror_observation=pair, mirror_action=pair.kept(np.arange(2)))
    rollout = filled_rollout()
    sign = torch.tensor([1.0, 1.0, -1.0])
    samples = ppo._samples(rollout, rollout.rewards, rollout.log_probabilities)
    minibatches = list(ppo._minibatches(samples, 32))
    assert [len(minibatch.returns) for minibatch in minibatches] == [8] * 4
    drawn = torch.cat([minibatch.advantages for minibatch in minibatches])
    torch.testing.assert_close(drawn.sort()[0], rollout.rewards.flatten().sort()[0], rtol=0, atol=0)
    for minibatch in minibatches:
        rows = [int((rollout.rewards.flatten() == advantage).nonzero()) for advantage in minibatch.advantages]
        observations, actions = rollout.observations.flatten(0, 1)[rows], rollout.actions.flatten(0, 1)[rows]
        assert torch.equal(minibatch.observations[:4], observations[:4, [1, 0, 2]] * sign)
        assert torch.equal(minibatch.observations[4:], observations[4:])
        assert torch.equal(minibatch.actions, torch.cat((actions[:4, [1, 0]], actions[4:])))


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu"])
@pytest.mark.parametrize("hidden_sizes", [[16, 12, 8], []])
def test_gradients_are_those_of_automatic_differentiation(activation: str, hidden_sizes: list[int]) -> None:
    """In float64, with ratios on both sides of the clip, an entropy bonus, and half of the minibatch mirrored."""
    pair = Mirror(np.array([1, 0, 2]), np.array([1.0, 1.0, -1.0], np.float32))
    mirrors = {"mirror_observation": pair, "mirror_action": pair.kept(np.arange(2))}
    settings: dict[str, Any] = {"activation": activation, "hidden_sizes": hidden_sizes, "minibatch_size": 32}
    torch.set_default_dtype(torch.float64)
    try:
        ppo = make_ppo(**settings, **mirrors, entropy_coefficient=0.03)
    finally:
        torch.set_default_dtype(torch.float32)
    generator = torch.Generator().manual_seed(1)
    ppo.weights.add_(torch.randn(ppo.weights.shape, generator=generator, dtype=torch.float64), alpha=0.2)
    rollout = filled_rollout()
    for name, tensor in vars(rollout).items():
        setattr(rollout, name, tensor.double() if tensor.is_floating_point() else tensor)
    mean, log_std, _ = networks(ppo, ppo.weights, rollout.observations)
    rollout.log_probabilities = normal(mean, log_std).log_prob(rollout.actions)
    rollout.log_probabilities += 0.5 * torch.randn(8, 4, generator=generator, dtype=torch.float64)
    samples = ppo._samples(rollout, rollout.rewards, rollout.rewards.exp())
    minibatch = next(ppo._minibatches(samples, 32))

    log_ratio = ppo.policy_gradient(minibatch)
    ppo.value_gradient(minibatch)
    written_out = ppo.gradient.clone()

    weights = ppo.weights.clone().requires_grad_()
    mean, log_std, values = networks(ppo, weights, minibatch.observations)
    by_autograd = normal(mean, log_std).log_prob(minibatch.actions) - minibatch.log_probabilities
    loss = clipped_policy_loss(by_autograd, minibatch.advantages, ppo.clip_ratio)
    loss = loss + ppo.value_coefficient * 0.5 * (values - minibatch.returns).square().mean()
    loss = loss - 0.03 * normal(mean, log_std).entropy().mean()
    (expected,) = torch.autograd.grad(loss, weights)

    torch.testing.assert_close(log_ratio, by_autograd, rtol=0, atol=1e-12)
    clipped = (log_ratio.exp() - 1.0).abs() > ppo.clip_ratio
    assert 0.2 < clipped.double().mean() < 0.9
    torch.testing.assert_close(written_out, expected, rtol=1e-9, atol=1e-12)


def test_gradient_is_clipped_over_both_networks() -> None:
    """The norm that is reported is the one before clipping; what is left has the length of the limit."""
    ppo = make_ppo(max_gradient_norm=0.01)
    rollout = filled_rollout()
    minibatch = next(ppo._minibatches(ppo._samples(rollout, rollout.rewards, rollout.rewards), 32))
    ppo.policy_gradient(minibatch)
    ppo.value_gradient(minibatch)
    norm = ppo.gradient.norm()
    _, _, reported = ppo._update_minibatch(minibatch)
    assert norm > 0.1
    assert reported.item() == pytest.approx(norm.item(), rel=1e-6)
    assert ppo.gradient.norm().item() == pytest.approx(0.01, rel=1e-4)


def test_second_lane_changes_no_bit() -> None:
    def trained(wanted: bool) -> torch.Tensor:
        with second_lane(wanted) as lane:
            ppo = make_ppo(seed=3, lane=lane)
            losses = [ppo.update(filled_rollout(seed)) for seed in range(3)]
        return torch.cat([ppo.weights, torch.tensor([*losses[-1].values()])])

    assert torch.equal(trained(False), trained(True))


def test_same_seed_same_weights() -> None:
    def trained() -> torch.Tensor:
        ppo = make_ppo(seed=3)
        ppo.update(filled_rollout())
        return ppo.weights

    assert torch.equal(trained(), trained())


def test_learning_rate_scale() -> None:
    ppo = make_ppo()
    ppo.update(filled_rollout(), learning_rate_scale=0.0)
    fresh = make_ppo()
    torch.testing.assert_close(ppo.weights, fresh.weights, rtol=0, atol=0)


def test_ppo_solves_a_bandit() -> None:
    """Reward -|a - 0.5|^2 with nothing to observe: the mean action goes to 0.5."""
    ppo = make_ppo(learning_rate=1e-2, gamma=0.0, minibatch_size=64, epochs=4)
    rollout = Rollout(steps=8, num_envs=32, observation_size=3, action_size=2)
    nothing = torch.zeros(32, 3)
    for _ in range(40):
        for step in range(8):
            action, log_probability = ppo.act(nothing)
            rollout.store_action(step, nothing, action, log_probability)
            reward = -(action - 0.5).square().sum(-1)
            ended = np.ones(32, bool)
            rollout.store_outcome(step, reward.numpy(), ended, ~ended, nothing.numpy())
        ppo.update(rollout)
    mean, _, _ = networks(ppo, ppo.weights, nothing[:1])
    torch.testing.assert_close(mean, torch.full((1, 2), 0.5), rtol=0, atol=0.05)


@pytest.mark.parametrize("activation", ["tanh", "elu"])
def test_policy_round_trip(activation: str, tmp_path: Path) -> None:
    """The loaded policy is what torch's own layers make of the tensors in the file, to the last bit."""
    ppo = make_ppo(activation=activation)
    ppo.policy.weights[-1].mul_(300.0)
    path = tmp_path / "policy.safetensors"
    save_ppo_policy(path, ppo)
    function = {"tanh": nn.Tanh, "elu": nn.ELU}[activation]
    network = nn.Sequential(nn.Linear(3, 16), function(), nn.Linear(16, 16), function(), nn.Linear(16, 2))
    tensors, _ = load_tensors(path)
    assert torch.equal(tensors.pop("log_std"), ppo.log_std)
    network.load_state_dict(tensors)
    observation = np.random.default_rng(0).normal(size=(40, 3)).astype(np.float32)
    with torch.no_grad():
        expected = network(torch.from_numpy(observation)).clamp(-1.0, 1.0).numpy()
    action = load_ppo_policy(path)(observation)
    assert action.dtype == np.float32
    assert (np.abs(action) == 1.0).any()
    np.testing.assert_array_equal(action, expected)


def test_a_policy_file_names_the_columns_that_it_reads(tmp_path: Path) -> None:
    path, names = tmp_path / "policy.safetensors", ("height", "left_load", "right_load")
    save_ppo_policy(path, make_ppo())
    load_ppo_policy(path, names=names)  # a file of old has none
    save_ppo_policy(path, make_ppo(), names)
    load_ppo_policy(path, names=names)
    with pytest.raises(ArtifactError, match="column 1 of what it reads is left_load; needed: right_load"):
        load_ppo_policy(path, names=("height", "right_load", "left_load"))
    save_ppo_policy(path, make_ppo(), names[:2])
    with pytest.raises(ArtifactError, match=r"observation_names \['height', 'left_load'\]; needed: 3 names"):
        load_ppo_policy(path)
