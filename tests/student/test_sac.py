"""SAC against numbers worked out without it."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy import integrate

from romgrl.algorithms.sac import SAC, TwinCritic, flatten_parameters, load_policy, save_policy, tanh_log_probability
from romgrl.buffers import Batch

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
    "seed": 0,
}


def make_batch(size: int = 16) -> Batch:
    generator = torch.Generator().manual_seed(1)

    def draw(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=generator)

    terminated = torch.zeros(size)
    terminated[::4] = 1
    return Batch(draw(size, 3), draw(size, 2).tanh(), draw(size, 3), draw(size), terminated, draw(size, 5))


def test_tanh_log_probability_is_a_density() -> None:
    """Its exponential integrates to one over the open interval of actions, and matches change of variables."""
    mean, std = 0.7, 0.6

    def density(action: float) -> float:
        u = torch.tensor([[math.atanh(action)]], dtype=torch.float64)
        log_std = torch.tensor([[math.log(std)]], dtype=torch.float64)
        return math.exp(float(tanh_log_probability((u - mean) / std, log_std, u)))

    assert integrate.quad(density, -1 + 1e-12, 1 - 1e-12, limit=200)[0] == pytest.approx(1.0, abs=1e-6)
    u = math.atanh(0.3)
    by_hand = math.exp(-0.5 * ((u - mean) / std) ** 2) / (std * math.sqrt(2 * math.pi)) / (1 - 0.3**2)
    assert density(0.3) == pytest.approx(by_hand, rel=1e-9)


def test_tanh_log_probability_far_out_stays_finite() -> None:
    pre_tanh = torch.tensor([[40.0, -40.0]])
    assert torch.isfinite(tanh_log_probability(torch.zeros(1, 2), torch.zeros(1, 2), pre_tanh)).all()


def critic_by_hand(critic: TwinCritic, inputs: np.ndarray) -> np.ndarray:
    values = []
    for k in range(2):
        x = inputs
        for layer, (weight, bias) in enumerate(zip(critic.weights, critic.biases, strict=True)):
            x = x @ weight[k].detach().numpy() + bias[k].detach().numpy()
            x = np.maximum(x, 0) if layer < len(critic.weights) - 1 else x
        values.append(x[:, 0])
    return np.stack(values)


@pytest.mark.parametrize(("join", "reduce"), [("minimum", np.min), ("mean", np.mean)])
def test_bellman_target(join: str, reduce: Callable[..., np.ndarray]) -> None:
    """y = r + gamma (1 - terminated) (Q' - alpha log pi), with networks evaluated in numpy."""
    sac = SAC(**{**SETTINGS, "critic_target": join})
    batch, reward = make_batch(), torch.linspace(-1, 1, 16)
    state = sac.generator.get_state()
    target = sac.bellman_target(batch, reward).numpy()
    sac.generator.set_state(state)
    with torch.no_grad():
        action, log_probability = sac.policy.sample(batch.next_observation, sac.generator)
    values = critic_by_hand(sac.target, torch.cat((batch.next_observation, action), -1).numpy())
    soft = reduce(values, axis=0) - 0.2 * log_probability.numpy()
    expected = reward.numpy() + 0.9 * (1 - batch.terminated.numpy()) * soft
    np.testing.assert_allclose(target, expected, atol=1e-5)
    np.testing.assert_allclose(target[::4], reward.numpy()[::4], atol=1e-7)


def test_critic_step_lowers_the_bellman_error_and_leaves_the_policy_alone() -> None:
    sac, batch, reward = SAC(**SETTINGS), make_batch(), torch.ones(16)
    before = sac.policy_flat.detach().clone()
    losses = [float(sac.update_critics(batch, reward)["critic_loss"]) for _ in range(200)]
    assert losses[-1] < 0.5 * losses[0]
    assert torch.equal(before, sac.policy_flat)


def test_policy_step_raises_the_value_and_leaves_the_critics_alone() -> None:
    sac, batch = SAC(**{**SETTINGS, "initial_temperature": 1e-6}), make_batch()
    before = sac.critic_flat.detach().clone()
    losses = [float(sac.update_policy_and_temperature(batch.observation)["policy_loss"]) for _ in range(300)]
    assert np.mean(losses[-20:]) < np.mean(losses[:20]) - 0.01
    assert torch.equal(before, sac.critic_flat)
    assert sac.critic_flat.grad is not None
    assert not sac.critic_flat.grad.any()


def test_temperature_falls_while_entropy_is_above_its_target() -> None:
    sac, batch = SAC(**{**SETTINGS, "target_entropy_scale": 50.0}), make_batch()
    for _ in range(20):
        sac.update_policy_and_temperature(batch.observation)
    assert float(sac.log_temperature.exp()) < 0.2


def test_targets_follow_by_tau_and_policy_waits() -> None:
    sac, batch = SAC(**SETTINGS), make_batch()
    target, reward = sac.target_flat.detach().clone(), torch.ones(16)
    assert "policy_loss" in sac.update(batch, reward)
    torch.testing.assert_close(sac.target_flat.data, torch.lerp(target, sac.critic_flat.data, 0.25))
    assert "policy_loss" not in sac.update(batch, reward)


def test_flat_parameters_are_the_modules_own() -> None:
    critic = TwinCritic(input_size=5, hidden_sizes=[4], layer_norm=True)
    flat = flatten_parameters(critic)
    flat.data.fill_(0.5)
    assert all((p == 0.5).all() for p in critic.parameters())
    critic(torch.ones(3, 5)).sum().backward()
    assert flat.grad is not None
    assert flat.grad.abs().sum() > 0


def test_same_seed_gives_the_same_weights() -> None:
    weights = []
    for _ in range(2):
        sac, batch = SAC(**SETTINGS), make_batch()
        for _ in range(50):
            sac.update(batch, batch.task_reward)
        weights.append(sac.policy_flat.detach().clone())
    assert torch.equal(*weights)


def test_policy_file_rebuilds_the_averaged_policy(tmp_path: Path) -> None:
    sac = SAC(**SETTINGS)
    columns, mean, scale = torch.tensor([4, 0, 2]), torch.ones(3), torch.full((3,), 2.0)
    save_policy(tmp_path / "policy.safetensors", sac, columns, mean, scale)
    observation = np.arange(10, dtype=np.float32).reshape(2, 5)
    with torch.no_grad():
        expected = sac.average((torch.from_numpy(observation)[:, [4, 0, 2]] - 1) * 2)[0].tanh()
    np.testing.assert_array_equal(load_policy(tmp_path / "policy.safetensors")(observation), expected.numpy())
