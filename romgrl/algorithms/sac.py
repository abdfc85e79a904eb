"""Soft actor-critic (Haarnoja et al. 2018) with twin critics as one stacked network and written-out gradients.

Each algorithm step is one method: `critic_gradient`, `policy_gradient` and what applies them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from romgrl.algorithms.divergence import require_finite
from romgrl.algorithms.networks import squashed_gaussian
from romgrl.algorithms.networks.stacked_mlp import StackedMLP
from romgrl.algorithms.policy_file import (
    COLUMN_NAMES,
    NETWORK,
    check_tensors,
    layer_sizes,
    read_mirror,
    read_policy,
    require_humanoid,
)
from romgrl.algorithms.replay_buffer import Batch
from romgrl.algorithms.second_thread import submit_or_run
from romgrl.algorithms.tensor_state import optimizer_state, put_all, restore_optimizer
from romgrl.artifacts import save_tensors
from romgrl.gait.symmetry import Mirror

Metrics = dict[str, Tensor]
MIRRORS = tuple(f"mirror_{of}_{part}" for of in ("observation", "action") for part in Mirror._fields)
"""Tensors of a policy's file that hold its mirrors."""


class SAC:
    """The learner: networks, optimisers and one method per gradient.

    `simultaneous`: both gradients of an update are taken at the same point, before either is applied. They then need
    nothing of one another, so that `lane`, an executor of one thread, can compute the policy's beside the critics';
    the numbers are the same with and without it. Otherwise the policy sees the critics after their step, and makes
    `policy_updates` of its own in a row, each with the temperature's and with fresh noise, in every `policy_delay`-th
    update. Raises ValueError for more than one of them at the same point.
    """

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
        policy_updates: int = 1,
        initial_log_std: float | None = None,
        simultaneous: bool = False,
        lane: Executor | None = None,
        device: str = "cpu",
    ) -> None:
        if simultaneous and policy_updates > 1:
            raise ValueError(f"{policy_updates} policy updates in a row cannot be simultaneous with the critics'")
        torch.manual_seed(seed)
        self.generator = torch.Generator(device=device).manual_seed(seed)
        self.gamma, self.tau, self.policy_delay, self.critic_target = gamma, tau, policy_delay, critic_target
        self.action_size, self.target_entropy = action_size, -target_entropy_scale * action_size
        self.policy_average, self.policy_updates = policy_average, policy_updates
        self.simultaneous, self.lane = simultaneous, lane
        shape: dict[str, Any] = {"hidden_sizes": hidden_sizes, "layer_norm": layer_norm}
        self.network: dict[str, Any] = {"inputs": observation_size, "outputs": 2 * action_size, **shape}
        critic: dict[str, Any] = {"inputs": observation_size + action_size, "outputs": 1, "stack": 2, **shape}
        self.policy, self.average = (StackedMLP(stack=1, **self.network, device=device) for _ in range(2))
        self.critic, self.target = (StackedMLP(**critic, device=device) for _ in range(2))
        if initial_log_std is not None:
            squashed_gaussian.start_at(self.policy.weights[-1], self.policy.biases[-1], initial_log_std)
        self.average.flat.copy_(self.policy.flat)
        self.target.flat.copy_(self.critic.flat)
        self.log_temperature = torch.tensor([math.log(initial_temperature)], device=device)
        self.log_temperature.grad = torch.zeros_like(self.log_temperature)
        policy = {"params": [self.policy.flat], "lr": policy_learning_rate}
        temperature = {"params": [self.log_temperature], "lr": temperature_learning_rate}
        self.policy_optimizer = torch.optim.Adam([policy, temperature], fused=True)
        self.critic_optimizer = torch.optim.Adam([self.critic.flat], lr=critic_learning_rate, fused=True)
        self.actions = slice(observation_size, observation_size + action_size)
        self.updates = 0

    def scale_target_entropy(self, scale: float) -> None:
        """Let the temperature aim at an entropy of -scale x number of actions from now on."""
        self.target_entropy = -scale * self.action_size

    def act(self, observation: Tensor) -> Tensor:
        """Exploring actions (N, A) for observations (N, columns)."""
        return self.sample(observation, self._noise(1, len(observation))[0], "act").action

    def sample(self, observation: Tensor, noise: Tensor, use: str) -> squashed_gaussian.Sample:
        """Actions of the policy for observations (B, columns) with noise (B, A); `use` names the tape that is kept."""
        head = self.policy.forward(observation, self.policy.kept_tape(len(observation), use))
        return squashed_gaussian.sample(head[0], noise)

    def update(self, batch: Batch, reward: Tensor) -> Metrics:
        """One SAC update on a batch with its n-step return (B,); returns scalars to log."""
        next_noise, *noises = self._noise(1 + self.policy_updates, len(reward))
        due = self.updates % self.policy_delay == 0
        policy: Callable[[], Metrics] | None = None
        following = submit_or_run(self.lane, self.sample, batch.next_observation, next_noise, "next_policy")
        if due and self.simultaneous:
            policy = submit_or_run(self.lane, self.policy_gradient, batch.observation, noises[0])
        metrics = self.critic_gradient(batch, reward, following)
        metrics |= policy() if policy is not None else {}
        require_finite(critic_loss=metrics["critic_loss"], critic_gradient=self.critic.gradient)
        self.critic_optimizer.step()
        for noise in noises if due else ():
            if not self.simultaneous:
                metrics |= self.policy_gradient(batch.observation, noise)
            require_finite(policy_loss=metrics["policy_loss"], policy_gradient=self.policy.gradient)
            self.policy_optimizer.step()
            self.average.flat.lerp_(self.policy.flat, 1 - self.policy_average)
        self.target.flat.lerp_(self.critic.flat, self.tau)
        require_finite(
            policy_weights=self.policy.flat, critic_weights=self.critic.flat, temperature=self.log_temperature
        )
        self.updates += 1
        return metrics

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        return {
            "updates": self.updates,
            "generator": self.generator.get_state(),
            "tensors": self._tensors(),
            "policy_optimizer": optimizer_state(self.policy_optimizer),
            "critic_optimizer": optimizer_state(self.critic_optimizer),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.updates = state["updates"]
        self.generator.set_state(state["generator"])
        put_all(self._tensors(), state["tensors"])
        restore_optimizer(self.policy_optimizer, state.get("policy_optimizer", {}))
        restore_optimizer(self.critic_optimizer, state.get("critic_optimizer", {}))

    def _tensors(self) -> dict[str, Tensor]:
        networks = {"policy": self.policy, "average": self.average, "critic": self.critic, "target": self.target}
        return {"log_temperature": self.log_temperature} | {name: part.flat for name, part in networks.items()}

    def bellman_target(self, batch: Batch, reward: Tensor, following: squashed_gaussian.Sample) -> Tensor:
        """y = r + gamma^n (1 - terminated) (Q'(s', a') - alpha log pi(a'|s')), (B,): r up to s', `following` a'."""
        inputs = torch.cat((batch.next_observation, following.action), -1)
        values = self.target.forward(inputs, self.target.kept_tape(len(inputs), "next_value")).squeeze(-1)
        value = values.amin(0) if self.critic_target == "minimum" else values.mean(0)
        soft_value = value - self.log_temperature.exp() * following.log_probability
        return reward + self.gamma ** batch.counts.sum(1) * (1 - batch.terminated) * soft_value

    def critic_gradient(
        self, batch: Batch, reward: Tensor, following: Callable[[], squashed_gaussian.Sample]
    ) -> Metrics:
        """Gradient of sum over the critics of mean (Q - y)^2; `following` gives the actions of the next states."""
        tape = self.critic.kept_tape(len(reward), "value")
        values = self.critic.forward(torch.cat((batch.observation, batch.action), -1), tape)
        target = self.bellman_target(batch, reward, following())
        error = values - target.unsqueeze(-1)
        self.critic.backward(error * (2 / len(reward)), tape)
        return {"critic_loss": error.square().sum() / len(reward), "value": values.mean()}

    def policy_gradient(self, observation: Tensor, noise: Tensor) -> Metrics:
        """Gradients of mean (alpha log pi - Q) by the policy and of alpha (entropy - its target) by log alpha."""
        size = len(observation)
        drawn = self.sample(observation, noise, "policy")
        tape = self.critic.kept_tape(size, "policy_value")
        values = self.critic.forward(torch.cat((observation, drawn.action), -1), tape)
        value, share = self._join(values)
        by_action = self.critic.backward(share * (-1 / size), tape, weights=False, inputs=self.actions)
        temperature = self.log_temperature.exp()
        by_head = squashed_gaussian.head_gradient(drawn, by_action, temperature / size)
        self.policy.backward(by_head.unsqueeze(0), self.policy.kept_tape(size, "policy"))
        entropy = -drawn.log_probability.mean()
        torch.mul(temperature, entropy - self.target_entropy, out=self.log_temperature.grad)
        loss = (temperature * drawn.log_probability - value).mean()
        return {"policy_loss": loss, "entropy": entropy, "temperature": temperature.squeeze()}

    def _join(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Joined value (B,) of both critics (2, B, 1), and its derivative by each."""
        if self.critic_target == "mean":
            return values.mean(0).squeeze(-1), torch.full_like(values, 0.5)
        smaller = values.amin(0)
        first = values[:1] <= values[1:]
        return smaller.squeeze(-1), torch.cat((first, ~first)).to(values.dtype)

    def _noise(self, *shape: int) -> Tensor:
        return torch.randn((*shape, self.action_size), generator=self.generator, device=self.log_temperature.device)


class Mirrors(NamedTuple):
    """Left and right exchanged in the columns that a policy reads and in its actions."""

    observation: Mirror
    action: Mirror


class SACPolicy:
    """The mean action of a trained policy: (N, O) float32 -> (N, A) float32 in [-1, 1].

    With `mirrors` it is the mean of that and of the image of what it does in the mirrored world, so that left and right
    are treated alike, whatever is left of the difference after a training with mirrored transitions.
    """

    def __init__(
        self,
        policy: StackedMLP,
        columns: Tensor,
        mean: Tensor,
        scale: Tensor,
        *,
        mirrors: Mirrors | None = None,
        names: Sequence[str] | None = None,
    ) -> None:
        self.policy, self.columns, self.mean, self.scale, self.names = policy, columns, mean, scale, names
        self.mirrors = mirrors

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = torch.from_numpy(observation)[:, self.columns]
        if self.mirrors is None:
            return self._mean_action(seen).numpy()
        action, mirrored = self._mean_action(torch.cat((seen, self.mirrors.observation.image(seen)))).chunk(2)
        return (0.5 * (action + self.mirrors.action.image(mirrored))).numpy()

    def _mean_action(self, seen: Tensor) -> Tensor:
        inputs = (seen - self.mean) * self.scale
        return torch.tanh(self.policy.forward(inputs, self.policy.tape(len(inputs)))[0].chunk(2, -1)[0])


def save_sac_policy(
    path: Path,
    sac: SAC,
    columns: Tensor,
    mean: Tensor,
    scale: Tensor,
    humanoid: Mapping[str, str] | None = None,
    names: Sequence[str] | None = None,
    mirrors: Mirrors | None = None,
) -> None:
    """Write the averaged policy with the columns it reads and their normalisation (safetensors).

    `humanoid`: the fingerprint of the model and the words that explain it; `names`: of the columns; `mirrors`: see
    SACPolicy.
    """
    tensors = {f"policy.{name}": value.cpu().clone() for name, value in sac.average.named_tensors().items()}
    tensors |= {"columns": columns.cpu(), "observation_mean": mean.cpu(), "observation_scale": scale.cpu()}
    if mirrors is not None:
        tensors |= dict(zip(MIRRORS, (part for mirror in mirrors for part in mirror), strict=True))
    network = {"algorithm": "sac", "humanoid": humanoid, COLUMN_NAMES: names, **sac.network}
    save_tensors(path, tensors, {NETWORK: json.dumps(network)})


def load_sac_policy(path: Path, humanoid: Mapping[str, str] | None = None) -> SACPolicy:
    """Rebuild a policy from its file alone. Raises ArtifactError for any other file.

    `humanoid`: the model that it must have been trained on, as `save_sac_policy` takes it; None: any.
    """
    sizes, options = ("inputs", "outputs"), {"layer_norm": (True, False)}
    tensors, network, trained_on, names = read_policy(path, algorithm="sac", sizes=sizes, options=options)
    if humanoid is not None:
        require_humanoid(path, trained_on, humanoid)
    columns = (network["inputs"],)
    needed: dict[str, tuple[torch.dtype, tuple[int, ...]]] = {"columns": (torch.int64, columns)}
    needed |= dict.fromkeys(("observation_mean", "observation_scale"), (torch.float32, columns))
    for layer, (inputs, outputs) in enumerate(layer_sizes(network, *sizes)):
        needed[f"policy.weight_{layer}"] = (torch.float32, (1, inputs, outputs))
        needed[f"policy.bias_{layer}"] = (torch.float32, (1, 1, outputs))
    actions = network["outputs"] // 2
    mirrored = MIRRORS[0] in tensors
    if mirrored:
        sizes_of_mirrors = (network["inputs"], network["inputs"], actions, actions)
        for name, size in zip(MIRRORS, sizes_of_mirrors, strict=True):
            needed[name] = (torch.float32 if name.endswith("sign") else torch.int64, (size,))
    check_tensors(path, tensors, needed)
    pairs = (MIRRORS[:2], MIRRORS[2:])
    mirrors = Mirrors(*(read_mirror(path, tensors, *pair) for pair in pairs)) if mirrored else None
    policy = StackedMLP(stack=1, **network)
    for name, value in policy.named_tensors().items():
        value.copy_(tensors[f"policy.{name}"])
    moments = tensors["observation_mean"], tensors["observation_scale"]
    return SACPolicy(policy, tensors["columns"], *moments, mirrors=mirrors, names=names)
