"""SAC against numbers worked out without it."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy import integrate

from romgrl.algorithms.networks.squashed_gaussian import head_gradient, log_density, sample
from romgrl.algorithms.networks.stacked_mlp import StackedMLP
from romgrl.algorithms.replay_buffer import Batch
from romgrl.algorithms.sac import SAC, Mirrors, load_sac_policy, save_sac_policy
from romgrl.algorithms.second_thread import second_lane
from romgrl.errors import ArtifactError
from romgrl.gait.symmetry import Mirror
from tests.helpers.automatic_gradients import forward_by_autograd

SETTINGS = {
    "observation_size": 3,
    "action_size": 2,
    "hidden_sizes": [8, 8],
    "layer_norm": False,
    "policy_learning_rate": 1e-3,
    "critic_learning_rate": 1e-3,
    "temperature_learning_rate": 1e-3,
    "initial_temperature": 0.2,
    "target_entropy_scale": 0.5,
    "gamma": 0.9,
    "tau": 0.25,
    "policy_delay": 2,
    "critic_target": "minimum",
    "policy_average": 0.5,
    "simultaneous": False,
    "seed": 0,
}


def make_batch(size: int = 16) -> Batch:
    generator = torch.Generator().manual_seed(1)

    def draw(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=generator)

    terminated = torch.zeros(size)
    terminated[::4] = 1
    return Batch(
        draw(size, 3),
        draw(size, 2).tanh(),
        draw(size, 3),
        terminated,
        torch.ones((size, 1)),
        draw(size, 1),
        draw(size, 1, 5),
        draw(size, 1),
    )


def test_log_density_is_a_density() -> None:
    """Its exponential integrates to one over the open interval of actions, and matches change of variables."""
    mean, std = 0.7, 0.6

    def density(action: float) -> float:
        u = torch.tensor([[math.atanh(action)]], dtype=torch.float64)
        log_std = torch.tensor([[math.log(std)]], dtype=torch.float64)
        return math.exp(float(log_density((u - mean) / std, log_std, u)))

    assert integrate.quad(density, -1 + 1e-12, 1 - 1e-12, limit=200)[0] == pytest.approx(1.0, abs=1e-6)
    u = math.atanh(0.3)
    by_hand = math.exp(-0.5 * ((u - mean) / std) ** 2) / (std * math.sqrt(2 * math.pi)) / (1 - 0.3**2)
    assert density(0.3) == pytest.approx(by_hand, rel=1e-9)


def test_a_first_policy_of_a_given_deviation() -> None:
    sac, observation = SAC(**{**SETTINGS, "initial_log_std": math.log(0.15)}), torch.randn(500, 3)
    drawn = sac.sample(observation, torch.zeros(500, 2), "test")
    assert drawn.deviation.mean().item() == pytest.approx(0.15, rel=0.1)
    assert drawn.deviation.std().item() < 0.02
    assert torch.equal(sac.average.flat, sac.policy.flat)


def test_log_density_far_out_stays_finite() -> None:
    pre_tanh = torch.tensor([[40.0, -40.0]])
    assert torch.isfinite(log_density(torch.zeros(1, 2), torch.zeros(1, 2), pre_tanh)).all()


def critic_by_hand(critic: StackedMLP, inputs: np.ndarray) -> np.ndarray:
    values = []
    for k in range(2):
        x = inputs
        for layer, (weight, bias) in enumerate(zip(critic.weights, critic.biases, strict=True)):
            x = x @ weight[k].numpy() + bias[k].numpy()
            x = np.maximum(x, 0) if layer < len(critic.weights) - 1 else x
        values.append(x[:, 0])
    return np.stack(values)


@pytest.mark.parametrize(("join", "reduce"), [("minimum", np.min), ("mean", np.mean)])
def test_bellman_target(join: str, reduce: Callable[..., np.ndarray]) -> None:
    """y = r + gamma^n (1 - terminated) (Q' - alpha log pi), with networks evaluated in numpy."""
    sac = SAC(**{**SETTINGS, "critic_target": join})
    batch, reward, noise = make_batch(), torch.linspace(-1, 1, 16), torch.randn(16, 2)
    batch.counts = (torch.arange(3) <= torch.arange(16)[:, None] % 3).float()
    drawn = sac.sample(batch.next_observation, noise, "test")
    target = sac.bellman_target(batch, reward, drawn).numpy()
    values = critic_by_hand(sac.target, torch.cat((batch.next_observation, drawn.action), -1).numpy())
    soft = reduce(values, axis=0) - 0.2 * drawn.log_probability.numpy()
    expected = reward.numpy() + 0.9 ** (1 + np.arange(16) % 3) * (1 - batch.terminated.numpy()) * soft
    np.testing.assert_allclose(target, expected, atol=1e-5)
    np.testing.assert_allclose(target[::4], reward.numpy()[::4], atol=1e-7)


def test_gradient_through_the_squashed_gaussian_equals_the_automatic_one() -> None:
    torch.manual_seed(0)
    head, noise = torch.randn(6, 4, dtype=torch.float64, requires_grad=True), torch.randn(6, 2, dtype=torch.float64)
    by_action, by_log = torch.randn(6, 2, dtype=torch.float64), torch.randn(6, 1, dtype=torch.float64)
    drawn = sample(head, noise)
    ((drawn.action * by_action).sum() + (drawn.log_probability[:, None] * by_log).sum()).backward()
    assert head.grad is not None
    with torch.no_grad():
        by_hand = head_gradient(sample(head, noise), by_action, by_log)
    torch.testing.assert_close(by_hand, head.grad, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("join", ["minimum", "mean"])
@pytest.mark.parametrize("layer_norm", [False, True])
def test_gradients_of_an_update_equal_those_of_its_losses(join: str, layer_norm: bool) -> None:
    """Critics: sum of mean (Q - y)^2; policy: mean (alpha log pi - Q); temperature: alpha (entropy - target)."""
    sac, batch = SAC(**{**SETTINGS, "critic_target": join, "layer_norm": layer_norm}), make_batch()
    noise, reward = torch.randn(16, 2), torch.linspace(-1, 1, 16)
    critic, policy = (network.flat.clone().requires_grad_() for network in (sac.critic, sac.policy))
    temperature = sac.log_temperature.detach().clone().requires_grad_()
    following = sac.sample(batch.next_observation, noise, "test")
    target = sac.bellman_target(batch, reward, following)
    inputs = torch.cat((batch.observation, batch.action), -1)
    (forward_by_autograd(sac.critic, "relu", critic, inputs).squeeze(-1) - target).square().mean(1).sum().backward()
    drawn = sample(forward_by_autograd(sac.policy, "relu", policy, batch.observation)[0], noise)
    values = forward_by_autograd(
        sac.critic, "relu", critic.detach(), torch.cat((batch.observation, drawn.action), -1)
    ).squeeze(-1)
    value = values.amin(0) if join == "minimum" else values.mean(0)
    (0.2 * drawn.log_probability - value).mean().backward()
    (temperature.exp() * (-drawn.log_probability.mean().detach() - sac.target_entropy)).sum().backward()
    sac.critic_gradient(batch, reward, lambda: following)
    torch.testing.assert_close(sac.critic.gradient, critic.grad, rtol=1e-4, atol=1e-6)
    sac.policy_gradient(batch.observation, noise)
    torch.testing.assert_close(sac.policy.gradient, policy.grad, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(sac.log_temperature.grad, temperature.grad, rtol=1e-4, atol=1e-6)


def test_critics_learn_and_leave_the_policy_alone() -> None:
    sac, batch, reward = SAC(**{**SETTINGS, "policy_delay": 10**6}), make_batch(), torch.ones(16)
    sac.updates = 1
    before = sac.policy.flat.clone()
    losses = [float(sac.update(batch, reward)["critic_loss"]) for _ in range(200)]
    assert losses[-1] < 0.5 * losses[0]
    assert torch.equal(before, sac.policy.flat)


def test_policy_gradient_raises_the_value_and_leaves_the_critics_alone() -> None:
    sac, batch = SAC(**{**SETTINGS, "initial_temperature": 1e-6}), make_batch()
    before, losses = sac.critic.flat.clone(), []
    for _ in range(300):
        losses.append(float(sac.policy_gradient(batch.observation, torch.randn(16, 2))["policy_loss"]))
        sac.policy_optimizer.step()
    assert np.mean(losses[-20:]) < np.mean(losses[:20]) - 0.01
    assert torch.equal(before, sac.critic.flat)
    assert not sac.critic.gradient.any()


def test_temperature_falls_while_entropy_is_above_its_target() -> None:
    sac, batch = SAC(**{**SETTINGS, "target_entropy_scale": 50.0}), make_batch()
    for _ in range(20):
        sac.policy_gradient(batch.observation, torch.randn(16, 2))
        sac.policy_optimizer.step()
    assert float(sac.log_temperature.exp()) < 0.2


def test_temperature_rises_once_the_target_lies_above_the_entropy() -> None:
    sac, batch = SAC(**{**SETTINGS, "target_entropy_scale": 50.0}), make_batch()
    sac.scale_target_entropy(-50.0)
    for _ in range(20):
        sac.policy_gradient(batch.observation, torch.randn(16, 2))
        sac.policy_optimizer.step()
    assert float(sac.log_temperature.exp()) > 0.2


def test_targets_follow_by_tau_and_policy_waits() -> None:
    sac, batch = SAC(**SETTINGS), make_batch()
    target, reward = sac.target.flat.clone(), torch.ones(16)
    assert "policy_loss" in sac.update(batch, reward)
    torch.testing.assert_close(sac.target.flat, torch.lerp(target, sac.critic.flat, 0.25))
    assert "policy_loss" not in sac.update(batch, reward)


@pytest.mark.parametrize("simultaneous", [False, True])
def test_same_seed_gives_the_same_weights_with_one_lane_and_two(simultaneous: bool) -> None:
    weights = []
    for lanes in (1, 1, 2):
        with second_lane(lanes == 2) as lane:
            sac, batch = SAC(**{**SETTINGS, "simultaneous": simultaneous}, lane=lane), make_batch()
            for _ in range(50):
                sac.update(batch, batch.task_reward[:, 0])
        weights.append(torch.cat((sac.policy.flat, sac.critic.flat)))
    assert torch.equal(weights[0], weights[1])
    assert torch.equal(weights[0], weights[2])


def test_policy_sees_the_critics_of_before_only_where_gradients_are_simultaneous() -> None:
    changed = []
    for simultaneous in (False, True):
        sac, batch = SAC(**{**SETTINGS, "simultaneous": simultaneous, "critic_learning_rate": 0.0}), make_batch()
        sac.update(batch, batch.task_reward[:, 0])
        still = sac.policy.flat.clone()
        sac = SAC(**{**SETTINGS, "simultaneous": simultaneous, "critic_learning_rate": 0.5})
        sac.update(batch, batch.task_reward[:, 0])
        changed.append(not torch.equal(still, sac.policy.flat))
    assert changed == [True, False]


def test_policy_updates_in_a_row_are_those_made_one_by_one() -> None:
    """After the critics' step, each with noise of its own; nothing in the updates between."""
    row, single = (SAC(**{**SETTINGS, "policy_updates": count}) for count in (3, 1))
    batch, reward = make_batch(), torch.linspace(-1, 1, 16)
    next_noise, *noises = single._noise(4, 16)
    single.critic_gradient(batch, reward, lambda: single.sample(batch.next_observation, next_noise, "next_policy"))
    single.critic_optimizer.step()
    for noise in noises:
        single.policy_gradient(batch.observation, noise)
        single.policy_optimizer.step()
        single.average.flat.lerp_(single.policy.flat, 0.5)
    row.update(batch, reward)
    for name in ("policy", "average", "critic"):
        assert torch.equal(getattr(row, name).flat, getattr(single, name).flat), name
    assert torch.equal(row.log_temperature, single.log_temperature)
    before = row.policy.flat.clone()
    row.update(batch, reward)
    assert torch.equal(before, row.policy.flat)


def test_policy_updates_in_a_row_are_not_simultaneous() -> None:
    with pytest.raises(ValueError, match="2 policy updates in a row"):
        SAC(**{**SETTINGS, "policy_updates": 2, "simultaneous": True})


def test_policy_file_rebuilds_the_averaged_policy(tmp_path: Path) -> None:
    sac = SAC(**SETTINGS)
    columns, mean, scale = torch.tensor([4, 0, 2]), torch.ones(3), torch.full((3,), 2.0)
    save_sac_policy(tmp_path / "policy.safetensors", sac, columns, mean, scale)
    observation = np.arange(10, dtype=np.float32).reshape(2, 5)
    inputs = (torch.from_numpy(observation)[:, [4, 0, 2]] - 1) * 2
    expected = sac.average.forward(inputs, sac.average.tape(2))[0, :, :2].tanh()
    np.testing.assert_array_equal(load_sac_policy(tmp_path / "policy.safetensors")(observation), expected.numpy())


MIRRORED = Mirrors(
    Mirror(torch.tensor([1, 0, 2]), torch.tensor([1.0, 1.0, -1.0])), Mirror(torch.tensor([1, 0]), torch.ones(2))
)


def test_a_mirrored_policy_treats_left_and_right_alike(tmp_path: Path) -> None:
    """In the mirrored world it does the mirror image, and it is the mean of both sides' halves."""
    sac, path = SAC(**SETTINGS), tmp_path / "policy.safetensors"
    columns, mean, scale = torch.tensor([4, 0, 2]), torch.ones(3), torch.full((3,), 2.0)
    save_sac_policy(path, sac, columns, mean, scale, mirrors=MIRRORED)
    policy = load_sac_policy(path)
    world = np.random.default_rng(0).normal(size=(7, 5)).astype(np.float32)
    image = world.copy()
    image[:, 4], image[:, 0], image[:, 2] = world[:, 0], world[:, 4], -world[:, 2]
    np.testing.assert_allclose(policy(image), policy(world)[:, ::-1], atol=1e-6)
    save_sac_policy(path, sac, columns, mean, scale)
    one_sided = load_sac_policy(path)
    assert not np.allclose(one_sided(image), one_sided(world)[:, ::-1], atol=1e-3)
    np.testing.assert_allclose(policy(world), 0.5 * (one_sided(world) + one_sided(image)[:, ::-1]), atol=1e-6)


@pytest.mark.parametrize(
    ("permutation", "sign"),
    [([1, 2, 0], [1, 1, 1]), ([0, 1, 3], [1, 1, 1]), ([0, 1, -1], [1, 1, 1]), ([0, 1, 2], [1, 1, 2])],
)
def test_what_is_no_mirror_is_refused(permutation: list[int], sign: list[float], tmp_path: Path) -> None:
    broken = MIRRORED._replace(observation=Mirror(torch.tensor(permutation), torch.tensor(sign, dtype=torch.float32)))
    path = tmp_path / "policy.safetensors"
    save_sac_policy(path, SAC(**SETTINGS), torch.arange(3), torch.zeros(3), torch.ones(3), mirrors=broken)
    with pytest.raises(ArtifactError, match="mirror_observation_permutation and mirror_observation_sign are no mirror"):
        load_sac_policy(path)
