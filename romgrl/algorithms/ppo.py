"""Proximal policy optimisation (Schulman et al. 2017): generalised advantages, clipped loss, left-right mirroring."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from romgrl.artifacts import load_tensors, save_tensors
from romgrl.networks import initialise_orthogonal, mirror, mlp

LOG_TWO_PI = math.log(2.0 * math.pi)
Mirror = tuple[NDArray[np.int64], NDArray[np.float32]]


def gaussian_log_probability(actions: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Log density (N,) of (N, A) actions under independent Gaussians."""
    scaled = (actions - mean) * torch.exp(-log_std)
    return (-0.5 * (scaled.square() + LOG_TWO_PI) - log_std).sum(-1)


def gaussian_entropy(log_std: Tensor) -> Tensor:
    """Entropy (nats) of independent Gaussians, from their (A,) log standard deviations."""
    return (log_std + 0.5 * (1.0 + LOG_TWO_PI)).sum(-1)


def compute_gae(
    rewards: Tensor,
    values: Tensor,
    next_values: Tensor,
    terminated: Tensor,
    truncated: Tensor,
    gamma: float,
    gae_lambda: float,
) -> tuple[Tensor, Tensor]:
    """Advantages and returns, (T, N) each, from (T, N) inputs (Schulman et al. 2016, eq. 16).

    `next_values` are the values of the observations that each step led to, before any reset. A terminated step has no
    future; a truncated one keeps its bootstrap value, and no advantage flows back across either.
    """
    deltas = rewards + gamma * next_values * ~terminated - values
    decay = gamma * gae_lambda * ~(terminated | truncated)
    advantages = torch.empty_like(deltas)
    advantage = torch.zeros_like(deltas[0])
    for step in reversed(range(len(deltas))):
        advantage = deltas[step] + decay[step] * advantage
        advantages[step] = advantage
    return advantages, advantages + values


def clipped_policy_loss(log_ratio: Tensor, advantages: Tensor, clip_ratio: float) -> Tensor:
    """-E min(r A, clip(r, 1 - c, 1 + c) A) with r = exp(log_ratio), from (N,) inputs (Schulman et al. 2017, eq. 7)."""
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1.0 - clip_ratio, 1.0 + clip_ratio)
    return -torch.minimum(ratio * advantages, clipped * advantages).mean()


class Rollout:
    """Preallocated storage of `steps` steps of `num_envs` environments; every tensor is (steps, num_envs, ...)."""

    def __init__(
        self, *, steps: int, num_envs: int, observation_size: int, action_size: int, device: str = "cpu"
    ) -> None:
        shape = (steps, num_envs)
        self.observations = torch.zeros((*shape, observation_size), device=device)
        self.next_observations = torch.zeros_like(self.observations)
        self.actions = torch.zeros((*shape, action_size), device=device)
        self.log_probabilities = torch.zeros(shape, device=device)
        self.rewards = torch.zeros(shape, device=device)
        self.terminated = torch.zeros(shape, dtype=torch.bool, device=device)
        self.truncated = torch.zeros(shape, dtype=torch.bool, device=device)

    def store_action(self, step: int, observation: Tensor, action: Tensor, log_probability: Tensor) -> None:
        """What the policy saw and did at `step`."""
        self.observations[step] = observation
        self.actions[step] = action
        self.log_probabilities[step] = log_probability

    def store_outcome(
        self,
        step: int,
        reward: NDArray[np.floating],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
        next_observation: NDArray[np.float32],
    ) -> None:
        """What the environments answered; `next_observation` (N, O) is the one before any reset."""
        self.rewards[step] = torch.from_numpy(reward)
        self.terminated[step] = torch.from_numpy(terminated)
        self.truncated[step] = torch.from_numpy(truncated)
        self.next_observations[step] = torch.from_numpy(next_observation)


class PPO:
    """Gaussian policy with state-independent spread, and a separate value network.

    `mirror_observation`, `mirror_action`: (permutation, sign) pairs; with them half of each minibatch is mirrored.
    """

    def __init__(
        self,
        *,
        observation_size: int,
        action_size: int,
        hidden_sizes: Sequence[int],
        activation: str,
        learning_rate: float,
        gamma: float,
        gae_lambda: float,
        clip_ratio: float,
        epochs: int,
        minibatch_size: int,
        value_coefficient: float,
        entropy_coefficient: float,
        max_gradient_norm: float,
        initial_log_std: float,
        mirror_observation: Mirror | None = None,
        mirror_action: Mirror | None = None,
        seed: int = 0,
        device: str = "cpu",
    ) -> None:
        torch.manual_seed(seed)
        self.device = device
        self.generator = torch.Generator(device=device).manual_seed(seed)
        self.spec = {"hidden_sizes": list(hidden_sizes), "activation": activation}
        self.policy = mlp(observation_size, hidden_sizes, action_size, activation).to(device)
        self.value = mlp(observation_size, hidden_sizes, 1, activation).to(device)
        initialise_orthogonal(self.policy, output_gain=0.01)
        initialise_orthogonal(self.value, output_gain=1.0)
        self.log_std = nn.Parameter(torch.full((action_size,), float(initial_log_std), device=device))
        self.parameters = [*self.policy.parameters(), *self.value.parameters(), self.log_std]
        self.learning_rate = learning_rate
        self.optimizer = torch.optim.Adam(self.parameters, lr=learning_rate, eps=1e-5, fused=True)
        self.gamma, self.gae_lambda, self.clip_ratio = gamma, gae_lambda, clip_ratio
        self.epochs, self.minibatch_size = epochs, minibatch_size
        self.value_coefficient, self.entropy_coefficient = value_coefficient, entropy_coefficient
        self.max_gradient_norm = max_gradient_norm
        self.mirror_observation = _mirror_tensors(mirror_observation, device)
        self.mirror_action = _mirror_tensors(mirror_action, device)
        if (self.mirror_observation is None) != (self.mirror_action is None):
            raise ValueError("mirror_observation and mirror_action must be given together")

    @torch.no_grad()
    def act(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Sampled actions (N, A), not clipped, and their log probabilities (N,) for (N, O) observations."""
        mean = self.policy(observation)
        noise = torch.randn(mean.shape, generator=self.generator, device=self.device)
        action = mean + noise * self.log_std.exp()
        return action, gaussian_log_probability(action, mean, self.log_std)

    def update(self, rollout: Rollout, learning_rate_scale: float = 1.0) -> dict[str, float]:
        """`epochs` passes over one rollout in shuffled minibatches; means of the losses over all gradient steps."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate * learning_rate_scale
        advantages, returns = self._advantages(rollout)
        unexplained = advantages.var() / (returns.var() + 1e-8)
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        stored = (rollout.observations, rollout.actions, rollout.log_probabilities)
        batch = [tensor.flatten(0, 1) for tensor in (*stored, advantages, returns)]
        history = [
            self._update_minibatch(*(tensor[index] for tensor in batch))
            for _ in range(self.epochs)
            for index in self._minibatches(len(batch[0]))
        ]
        names = ("policy_loss", "value_loss", "approximate_kl", "clip_share", "gradient_norm")
        means = torch.stack(history).mean(0).tolist()
        return dict(zip(names, means, strict=True)) | {
            "explained_variance": 1.0 - float(unexplained),
            "action_std": float(self.log_std.detach().exp().mean()),
        }

    @torch.no_grad()
    def _advantages(self, rollout: Rollout) -> tuple[Tensor, Tensor]:
        """Advantages and returns, (T, N) each, of a rollout under the present value network."""
        values = self.value(rollout.observations).squeeze(-1)
        last_value = self.value(rollout.next_observations[-1]).squeeze(-1)
        next_values = torch.cat([values[1:], last_value[None]])
        truncated = rollout.truncated
        next_values[truncated] = self.value(rollout.next_observations[truncated]).squeeze(-1)
        return compute_gae(
            rollout.rewards, values, next_values, rollout.terminated, truncated, self.gamma, self.gae_lambda
        )

    def _minibatches(self, size: int) -> Iterator[Tensor]:
        """Shuffled indices of 0 .. size - 1 in equal parts of about `minibatch_size`."""
        order = torch.randperm(size, generator=self.generator, device=self.device)
        yield from order.chunk(max(1, round(size / self.minibatch_size)))

    def _update_minibatch(
        self, observations: Tensor, actions: Tensor, log_probabilities: Tensor, advantages: Tensor, returns: Tensor
    ) -> Tensor:
        """One gradient step; detached (policy loss, value loss, KL, clip share, gradient norm)."""
        if self.mirror_observation is not None and self.mirror_action is not None:
            half = len(observations) // 2
            observations[:half] = mirror(observations[:half], *self.mirror_observation)
            actions[:half] = mirror(actions[:half], *self.mirror_action)
        log_ratio = gaussian_log_probability(actions, self.policy(observations), self.log_std) - log_probabilities
        policy_loss = clipped_policy_loss(log_ratio, advantages, self.clip_ratio)
        value_loss = 0.5 * (self.value(observations).squeeze(-1) - returns).square().mean()
        entropy = gaussian_entropy(self.log_std)
        loss = policy_loss + self.value_coefficient * value_loss - self.entropy_coefficient * entropy
        self.optimizer.zero_grad()
        loss.backward()
        gradient_norm = nn.utils.clip_grad_norm_(self.parameters, self.max_gradient_norm)
        self.optimizer.step()
        log_ratio = log_ratio.detach()
        kl = (log_ratio.exp() - 1.0 - log_ratio).mean()
        clip_share = ((log_ratio.exp() - 1.0).abs() > self.clip_ratio).float().mean()
        return torch.stack([policy_loss.detach(), value_loss.detach(), kl, clip_share, gradient_norm])


def _mirror_tensors(pair: Mirror | None, device: str) -> tuple[Tensor, Tensor] | None:
    if pair is None:
        return None
    permutation, sign = pair
    return torch.as_tensor(permutation, device=device), torch.as_tensor(sign, dtype=torch.float32, device=device)


class DeterministicPolicy:
    """Mean of the Gaussian policy, clipped: (N, O) float32 -> (N, A) float32 in [-1, 1]."""

    def __init__(self, network: nn.Sequential) -> None:
        self.network = network.eval()

    @torch.no_grad()
    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        action: NDArray[np.float32] = self.network(torch.from_numpy(observation)).clamp_(-1.0, 1.0).numpy()
        return action


def save_policy(path: Path, ppo: PPO) -> None:
    """Write the policy network and its spread as safetensors, with what is needed to rebuild it in the metadata."""
    tensors = {name: tensor.detach().cpu() for name, tensor in ppo.policy.state_dict().items()}
    spec = {"algorithm": "ppo", "input_size": ppo.policy[0].in_features, "output_size": len(ppo.log_std), **ppo.spec}
    save_tensors(path, tensors | {"log_std": ppo.log_std.detach().cpu()}, {"network": json.dumps(spec)})


def load_policy(path: Path) -> DeterministicPolicy:
    """Deterministic policy from a file of `save_policy`."""
    tensors, metadata = load_tensors(path)
    spec = json.loads(metadata["network"])
    network = mlp(spec["input_size"], spec["hidden_sizes"], spec["output_size"], spec["activation"])
    network.load_state_dict({name: tensor for name, tensor in tensors.items() if name != "log_std"})
    return DeterministicPolicy(network)
