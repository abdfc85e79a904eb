"""Soft actor-critic (Haarnoja et al. 2018) with twin critics as one stacked network.

Each algorithm step is one method, in the order of the paper: critics, policy, temperature, targets.
"""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from romgrl.artifacts import load_tensors, save_tensors
from romgrl.buffers import Batch

LOG_STD_MIN, LOG_STD_MAX = -5.0, 2.0


def tanh_log_probability(noise: Tensor, log_std: Tensor, pre_tanh: Tensor) -> Tensor:
    """Log density (B,) of tanh(u), u = mean + exp(log_std) noise; log(1 - tanh^2 u) in its stable form."""
    gaussian = -0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)
    squash = 2.0 * (math.log(2.0) - pre_tanh - F.softplus(-2.0 * pre_tanh))
    return (gaussian - squash).sum(-1)


class Policy(nn.Module):
    """Squashed Gaussian policy: observation (B, columns) -> action (B, A) in [-1, 1]."""

    def __init__(self, *, observation_size: int, action_size: int, hidden_sizes: list[int], layer_norm: bool) -> None:
        super().__init__()
        sizes = [observation_size, *hidden_sizes]
        self.hidden = nn.ModuleList(nn.Linear(i, o) for i, o in pairwise(sizes))
        self.head = nn.Linear(sizes[-1], 2 * action_size)
        self.layer_norm = layer_norm

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean and log standard deviation before the tanh, (B, A) each."""
        x = observation
        for layer in self.hidden:
            x = layer(x)
            x = F.relu(F.layer_norm(x, x.shape[-1:]) if self.layer_norm else x)
        mean, log_std = self.head(x).chunk(2, -1)
        return mean, LOG_STD_MIN + 0.5 * (LOG_STD_MAX - LOG_STD_MIN) * (torch.tanh(log_std) + 1)

    def sample(self, observation: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw actions (B, A) by reparameterisation, with their log probability (B,)."""
        mean, log_std = self(observation)
        noise = torch.randn(mean.shape, generator=generator, device=mean.device)
        pre_tanh = mean + log_std.exp() * noise
        return torch.tanh(pre_tanh), tanh_log_probability(noise, log_std, pre_tanh)


class TwinCritic(nn.Module):
    """Two action values at once: (B, columns + A) -> (2, B). The first layers share one matrix product."""

    def __init__(self, *, input_size: int, hidden_sizes: list[int], layer_norm: bool) -> None:
        super().__init__()
        sizes = [input_size, *hidden_sizes, 1]
        self.layer_norm = layer_norm
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for inputs, outputs in pairwise(sizes):
            bound = 1 / math.sqrt(inputs)
            self.weights.append(nn.Parameter(torch.empty(2, inputs, outputs).uniform_(-bound, bound)))
            self.biases.append(nn.Parameter(torch.empty(2, 1, outputs).uniform_(-bound, bound)))

    def forward(self, inputs: Tensor, frozen: bool = False) -> Tensor:
        """Return both values (2, B); `frozen` keeps the critics' own gradients out."""
        x = inputs.expand(2, -1, -1)
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if frozen:
                weight, bias = weight.detach(), bias.detach()
            x = torch.baddbmm(bias, x, weight)
            if layer < len(self.weights) - 1:
                x = F.relu(F.layer_norm(x, x.shape[-1:]) if self.layer_norm else x)
        return x.squeeze(-1)


def flatten_parameters(module: nn.Module) -> nn.Parameter:
    """Lay all parameters and gradients of `module` into one flat vector each, so that one kernel updates them."""
    parameters = list(module.parameters())
    flat = nn.Parameter(torch.cat([p.detach().flatten() for p in parameters]))
    flat.grad = torch.zeros_like(flat)
    start = 0
    for parameter in parameters:
        end = start + parameter.numel()
        parameter.data = flat.data[start:end].view_as(parameter)
        parameter.grad = flat.grad[start:end].view_as(parameter)
        start = end
    return flat


class SAC:
    """The learner: networks, optimisers and one method per update."""

    def __init__(
        self,
        *,
        observation_size: int,
        action_size: int,
        hidden_sizes: list[int],
        layer_norm: bool,
        policy_learning_rate: float,
        critic_learning_rate: float,
        temperature_learning_rate: float,
        initial_temperature: float,
        target_entropy_scale: float,
        gamma: float,
        tau: float,
        policy_delay: int,
        critic_target: str,
        policy_average: float,
        seed: int,
        device: str = "cpu",
    ) -> None:
        torch.manual_seed(seed)
        self.generator = torch.Generator(device=device).manual_seed(seed)
        self.gamma, self.tau, self.policy_delay, self.critic_target = gamma, tau, policy_delay, critic_target
        self.target_entropy = -target_entropy_scale * action_size
        self.policy_average = policy_average
        network: dict[str, Any] = {"hidden_sizes": hidden_sizes, "layer_norm": layer_norm}
        self.network: dict[str, Any] = {"observation_size": observation_size, "action_size": action_size, **network}
        self.policy = Policy(**self.network).to(device)
        self.critic = TwinCritic(input_size=observation_size + action_size, **network).to(device)
        self.target = TwinCritic(input_size=observation_size + action_size, **network).to(device)
        self.average = Policy(**self.network).to(device)
        self.policy_flat = flatten_parameters(self.policy)
        self.critic_flat = flatten_parameters(self.critic)
        self.target_flat = flatten_parameters(self.target)
        self.average_flat = flatten_parameters(self.average)
        self.target_flat.data.copy_(self.critic_flat.data)
        self.average_flat.data.copy_(self.policy_flat.data)
        self.log_temperature = nn.Parameter(torch.tensor(math.log(initial_temperature), device=device))
        self.policy_optimizer = torch.optim.Adam([self.policy_flat], lr=policy_learning_rate, fused=True)
        self.critic_optimizer = torch.optim.Adam([self.critic_flat], lr=critic_learning_rate, fused=True)
        self.temperature_optimizer = torch.optim.Adam([self.log_temperature], lr=temperature_learning_rate)
        self.updates = 0

    @torch.no_grad()
    def act(self, observation: Tensor) -> Tensor:
        """Exploring actions (N, A) for observations (N, columns)."""
        return self.policy.sample(observation, self.generator)[0]

    def update(self, batch: Batch, reward: Tensor) -> dict[str, Tensor]:
        """One SAC update on a batch with its total reward (B,); returns detached scalars to log."""
        metrics = self.update_critics(batch, reward)
        if self.updates % self.policy_delay == 0:
            metrics |= self.update_policy_and_temperature(batch.observation)
        self.target_flat.data.lerp_(self.critic_flat.data, self.tau)
        self.updates += 1
        return metrics

    @torch.no_grad()
    def bellman_target(self, batch: Batch, reward: Tensor) -> Tensor:
        """y = r + gamma (1 - terminated) (Q'(s', a') - alpha log pi(a'|s')), (B,)."""
        next_action, log_probability = self.policy.sample(batch.next_observation, self.generator)
        value = self._join(self.target(torch.cat((batch.next_observation, next_action), -1)))
        soft_value = value - self.log_temperature.exp() * log_probability
        return reward + self.gamma * (1 - batch.terminated) * soft_value

    def update_critics(self, batch: Batch, reward: Tensor) -> dict[str, Tensor]:
        """Squared Bellman error of both critics."""
        target = self.bellman_target(batch, reward)
        value = self.critic(torch.cat((batch.observation, batch.action), -1))
        loss = F.mse_loss(value, target.expand(2, -1)) * 2
        _step(self.critic_optimizer, self.critic_flat, loss)
        return {"critic_loss": loss.detach(), "value": value.detach().mean()}

    def update_policy_and_temperature(self, observation: Tensor) -> dict[str, Tensor]:
        """Policy: alpha log pi - Q; temperature: entropy held at its target."""
        action, log_probability = self.policy.sample(observation, self.generator)
        value = self._join(self.critic(torch.cat((observation, action), -1), frozen=True))
        temperature = self.log_temperature.exp().detach()
        loss = (temperature * log_probability - value).mean()
        _step(self.policy_optimizer, self.policy_flat, loss)
        self.average_flat.data.lerp_(self.policy_flat.data, 1 - self.policy_average)
        entropy = -log_probability.detach().mean()
        temperature_loss = self.log_temperature.exp() * (entropy - self.target_entropy)
        self.temperature_optimizer.zero_grad()
        torch.autograd.backward(temperature_loss)
        self.temperature_optimizer.step()
        return {"policy_loss": loss.detach(), "entropy": entropy, "temperature": temperature}

    def _join(self, values: Tensor) -> Tensor:
        return values.amin(0) if self.critic_target == "minimum" else values.mean(0)


def _step(optimizer: torch.optim.Optimizer, flat: nn.Parameter, loss: Tensor) -> None:
    assert flat.grad is not None
    flat.grad.zero_()
    torch.autograd.backward(loss)
    optimizer.step()


class DeterministicPolicy:
    """The mean action of a trained policy: (N, 358) float32 -> (N, A) float32 in [-1, 1]."""

    def __init__(self, policy: Policy, columns: Tensor, mean: Tensor, scale: Tensor) -> None:
        self.policy, self.columns, self.mean, self.scale = policy, columns, mean, scale

    @torch.no_grad()
    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        inputs = (torch.from_numpy(observation)[:, self.columns] - self.mean) * self.scale
        action: NDArray[np.float32] = torch.tanh(self.policy(inputs)[0]).numpy()
        return action


def save_policy(
    path: Path, sac: SAC, columns: Tensor, mean: Tensor, scale: Tensor, metadata: dict[str, str] | None = None
) -> None:
    """Write the averaged policy with the columns it reads and their normalisation (safetensors)."""
    tensors = {f"policy.{name}": value.detach().cpu().clone() for name, value in sac.average.state_dict().items()}
    tensors |= {"columns": columns.cpu(), "observation_mean": mean.cpu(), "observation_scale": scale.cpu()}
    save_tensors(path, tensors, {"network": json.dumps(sac.network), **(metadata or {})})


def load_policy(path: Path) -> DeterministicPolicy:
    """Rebuild a policy from its file alone."""
    tensors, metadata = load_tensors(path)
    policy = Policy(**json.loads(metadata["network"]))
    prefix = "policy."
    policy.load_state_dict({k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)})
    return DeterministicPolicy(policy, tensors["columns"], tensors["observation_mean"], tensors["observation_scale"])
