"""What PPO does with a rollout: mirrored samples, the same bits for a seed, learning, policies in files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from romgrl.algorithms.ppo import Minibatch
from romgrl.algorithms.ppo_policy import load_ppo_policy, save_ppo_policy
from romgrl.algorithms.rollout_buffer import Rollout
from romgrl.algorithms.second_thread import second_lane
from romgrl.artifacts import load_tensors
from romgrl.errors import ArtifactError
from romgrl.gait.symmetry import Mirror, unsigned
from tests.algorithms.small_ppo import filled_rollout, make_ppo, networks, normal


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
    samples = ppo._samples(rollout, rollout.rewards, rollout.log_probabilities, rollout.rewards)
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
    save_ppo_policy(path, make_ppo(), ("x\nforged\x1b[31m" + "y" * 10_000, *names[1:]))
    with pytest.raises(ArtifactError) as error:
        load_ppo_policy(path, names=names)
    assert str(error.value).isprintable()
    assert len(str(error.value)) <= 2000
    save_ppo_policy(path, make_ppo(), names)
    with pytest.raises(ArtifactError, match="column 1 of what it reads is left_load; needed: right_load"):
        load_ppo_policy(path, names=("height", "right_load", "left_load"))
    save_ppo_policy(path, make_ppo(), names[:2])
    with pytest.raises(ArtifactError, match=r"observation_names \['height', 'left_load'\]; needed: 3 names"):
        load_ppo_policy(path)
