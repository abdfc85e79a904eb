"""Proximal policy optimisation (Schulman et al. 2017): clipped loss, written-out gradients, left-right mirroring."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, NamedTuple

import torch
from torch import Tensor

from romgrl.algorithms.networks.running_normalizer import RunningNormalizer
from romgrl.algorithms.networks.stacked_mlp import StackedMLP
from romgrl.algorithms.ppo_policy import LIMIT, PPOPolicy
from romgrl.algorithms.rollout_buffer import Rollout, compute_gae
from romgrl.algorithms.second_thread import submit_or_run
from romgrl.algorithms.tensor_state import optimizer_state, put, restore_optimizer
from romgrl.gait.symmetry import Mirror

LOG_TWO_PI = math.log(2.0 * math.pi)


def gaussian_log_probability(scaled: Tensor, log_std: Tensor) -> Tensor:
    """Log density (N,) of actions under independent Gaussians; `scaled` is (action - mean) / std, (N, A)."""
    return -0.5 * scaled.square().sum(-1) - (log_std + 0.5 * LOG_TWO_PI).sum()


def clipped_policy_loss(log_ratio: Tensor, advantages: Tensor, clip_ratio: float) -> Tensor:
    """-E min(r A, clip(r, 1 - c, 1 + c) A) with r = exp(log_ratio), from (N,) inputs (Schulman et al. 2017, eq. 7)."""
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1.0 - clip_ratio, 1.0 + clip_ratio)
    return -torch.minimum(ratio * advantages, clipped * advantages).mean()


class Minibatch(NamedTuple):
    """Samples of a rollout, N rows each: observations, returns and values as the networks see and give them."""

    observations: Tensor
    actions: Tensor
    log_probabilities: Tensor
    advantages: Tensor
    returns: Tensor
    values: Tensor  # before the update


class PPO:
    """Gaussian policy with state-independent spread, and a separate value network.

    `lane`: a second thread, in which the value network's gradient is computed; it changes no bit of the result.
    `mirror_observation`, `mirror_action`: with them half of each minibatch is mirrored.
    `normalize_observation`: the networks see observations in deviations from their running mean, at most LIMIT of them;
    `normalize_return`: the value network gives returns so. `value_clip`: how far a value may move in an update before
    its loss ends, in the unit of that network. `bootstrap_truncated` false: time that is up counts as a fall does.
    `segment_steps`: see `compute_gae`. `hidden_gain`, `policy_gain`: of the orthogonal weights that hidden layers and
    the policy's last one begin with.
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
        adam_epsilon: float = 1e-5,
        hidden_gain: float = math.sqrt(2.0),
        policy_gain: float = 0.01,
        value_clip: float | None = None,
        normalize_observation: bool = False,
        normalize_return: bool = False,
        bootstrap_truncated: bool = True,
        segment_steps: int | None = None,
        mirror_observation: Mirror | None = None,
        mirror_action: Mirror | None = None,
        lane: Executor | None = None,
        seed: int = 0,
        device: str = "cpu",
    ) -> None:
        torch.manual_seed(seed)
        self.device = device
        self.generator = torch.Generator(device=device).manual_seed(seed)
        self.spec: dict[str, Any] = {"hidden_sizes": list(hidden_sizes), "activation": activation}
        self.policy, self.value = (
            StackedMLP(stack=1, inputs=observation_size, outputs=size, linear=True, device=device, **self.spec)
            for size in (action_size, 1)
        )
        self.policy.initialise_orthogonal(policy_gain, hidden_gain)
        self.value.initialise_orthogonal(1.0, hidden_gain)
        self._gather(torch.full((action_size,), float(initial_log_std), device=device))
        self.learning_rate, self.lane = learning_rate, lane
        self.optimizer = torch.optim.Adam([self.weights], lr=learning_rate, eps=adam_epsilon, fused=True)
        self.observations = RunningNormalizer(
            observation_size, enabled=normalize_observation, limit=LIMIT, device=device
        )
        self.returns = RunningNormalizer(1, enabled=normalize_return, limit=LIMIT, device=device)
        self.value_clip = value_clip
        self.bootstrap_truncated, self.segment_steps = bootstrap_truncated, segment_steps
        self.gamma, self.gae_lambda, self.clip_ratio = gamma, gae_lambda, clip_ratio
        self.epochs, self.minibatch_size = epochs, minibatch_size
        self.value_coefficient, self.entropy_coefficient = value_coefficient, entropy_coefficient
        self.max_gradient_norm = max_gradient_norm
        self.mirror_observation = mirror_observation and mirror_observation.tensors(device)
        self.mirror_action = mirror_action and mirror_action.tensors(device)
        if (mirror_observation is None) != (mirror_action is None):
            raise ValueError("mirror_observation and mirror_action must be given together")

    def _gather(self, log_std: Tensor) -> None:
        """Put all parameters into one vector, for one step of the optimiser and one norm."""
        parts = (self.policy.flat, self.value.flat, log_std)
        self.weights = torch.cat(parts)
        self.weights.grad = self.gradient = torch.zeros_like(self.weights)
        sizes = [len(part) for part in parts]
        policy, value, spread = zip(torch.split(self.weights, sizes), torch.split(self.gradient, sizes), strict=True)
        self.policy.place(*policy)
        self.value.place(*value)
        self.log_std, self.log_std_gradient = spread

    def act(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Sampled actions (N, A), not clipped, and their log probabilities (N,) for (N, O) observations."""
        observation = self._seen(observation)
        mean = self.policy.forward(observation, self.policy.kept_tape(len(observation), "act"))[0]
        noise = torch.randn(mean.shape, generator=self.generator, device=self.device)
        action = torch.addcmul(mean, noise, self.log_std.exp())
        return action, gaussian_log_probability(noise, self.log_std)

    def mean_policy(self) -> PPOPolicy:
        """A copy of the policy as it is now, without exploration."""
        network = StackedMLP(
            stack=1, inputs=self.policy.sizes[0], outputs=len(self.log_std), linear=True, exact=True, **self.spec
        )
        network.flat.copy_(self.policy.flat)
        mean, scale = (moment.cpu() for moment in self.observations.mean_and_scale())
        return PPOPolicy(network, (mean, scale) if self.observations.enabled else None)

    def policy_vector(self) -> Tensor:
        """A copy of all that makes the mean action: weights and, where observations are normalised, mean and scale."""
        moments = self.observations.mean_and_scale() if self.observations.enabled else ()
        return torch.cat((self.policy.flat, *moments))

    def put_policy_vector(self, vector: Tensor) -> None:
        """Take over what `policy_vector` gave."""
        weights, moments = vector.tensor_split([len(self.policy.flat)])
        self.policy.flat.copy_(weights)
        if self.observations.enabled:
            self.observations.use(*moments.chunk(2))

    def update(self, rollout: Rollout, learning_rate_scale: float = 1.0) -> dict[str, float]:
        """`epochs` passes over one rollout in shuffled minibatches; means of the losses over all gradient steps."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate * learning_rate_scale
        advantages, returns, values = self._advantages(rollout)
        unexplained = advantages.var() / (returns.var() + 1e-8)
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        self.observations.update(rollout.observations.flatten(0, 1))
        self.returns.update(returns.flatten()[:, None])
        samples = self._samples(rollout, advantages, self.returns.apply_(returns), values)
        history = [
            (minibatch.advantages, *self._update_minibatch(minibatch))
            for _ in range(self.epochs)
            for minibatch in self._minibatches(samples, advantages.numel())
        ]
        seen, log_ratio, value_error, gradient_norm = (torch.cat(column) for column in zip(*history, strict=True))
        ratio = log_ratio.exp()
        losses = {
            "policy_loss": clipped_policy_loss(log_ratio, seen, self.clip_ratio),
            "value_loss": 0.5 * value_error.square().mean(),
            "approximate_kl": (ratio - 1.0 - log_ratio).mean(),
            "clip_share": ((ratio - 1.0).abs() > self.clip_ratio).float().mean(),
            "gradient_norm": gradient_norm.mean(),
            "explained_variance": 1.0 - unexplained,
            "action_std": self.log_std.exp().mean(),
        }
        return {name: float(value) for name, value in losses.items()}

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        generator, optimizer = self.generator.get_state(), optimizer_state(self.optimizer)
        normalizers = {"observations": self.observations.state(), "returns": self.returns.state()}
        return {"weights": self.weights, "generator": generator, "optimizer": optimizer, **normalizers}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        put("weights", self.weights, state["weights"])
        self.generator.set_state(state["generator"])
        restore_optimizer(self.optimizer, state.get("optimizer", {}))
        self.observations.restore(state["observations"])
        self.returns.restore(state["returns"])

    def _advantages(self, rollout: Rollout) -> tuple[Tensor, Tensor, Tensor]:
        """Advantages and returns of a rollout, and its values as the network gives them, (T, N) each."""
        given = self._values(rollout.observations.flatten(0, 1)).view_as(rollout.rewards)
        last = self._values(rollout.next_observations[-1])[None]
        values = self.returns.undo(given)
        next_values = torch.cat([values[1:], self.returns.undo(last)])
        terminated, truncated = rollout.terminated, rollout.truncated
        if self.bootstrap_truncated:
            next_values[truncated] = self.returns.undo(self._values(rollout.next_observations[truncated]))
        else:
            terminated = terminated | truncated
        advantages, returns = compute_gae(
            rollout.rewards,
            values,
            next_values,
            terminated,
            truncated,
            self.gamma,
            self.gae_lambda,
            self.segment_steps,
        )
        return advantages, returns, given

    def _seen(self, observations: Tensor) -> Tensor:
        """Observations (N, O) as the networks see them; the originals stay as they are."""
        return self.observations.apply_(observations.clone()) if self.observations.enabled else observations

    def _values(self, observations: Tensor) -> Tensor:
        """What the value network gives (N,) for observations (N, O)."""
        return self.value.forward(self._seen(observations), self.value.tape(len(observations)))[0, :, 0]

    def _samples(self, rollout: Rollout, advantages: Tensor, returns: Tensor, values: Tensor) -> Minibatch:
        """All samples of a rollout and, after them, their mirror images if there is a mirror."""
        stored = (rollout.observations, rollout.actions, rollout.log_probabilities, advantages, returns, values)
        samples = Minibatch(*(tensor.flatten(0, 1) for tensor in stored))
        seen = self._seen(samples.observations)
        if self.mirror_observation is None or self.mirror_action is None:
            return samples._replace(observations=seen)
        images = samples._replace(
            observations=self._seen(self.mirror_observation.image(samples.observations)),
            actions=self.mirror_action.image(samples.actions),
        )
        samples = samples._replace(observations=seen)
        return Minibatch(*(torch.cat(pair) for pair in zip(samples, images, strict=True)))

    def _minibatches(self, samples: Minibatch, size: int) -> Iterator[Minibatch]:
        """The `size` samples shuffled, in equal parts of about `minibatch_size`; images in the first half of each."""
        order = torch.randperm(size, generator=self.generator, device=self.device)
        parts = max(1, round(size / self.minibatch_size))
        if self.mirror_observation is not None:
            for part in order.chunk(parts):
                part[: len(part) // 2] += size
        shuffled = [tensor.index_select(0, order).chunk(parts) for tensor in samples]
        yield from (Minibatch(*tensors) for tensors in zip(*shuffled, strict=True))

    def _update_minibatch(self, minibatch: Minibatch) -> tuple[Tensor, Tensor, Tensor]:
        """One gradient step; log ratios (N,), errors of the values (N,) and norm of the gradient (1,) before it."""
        value_error = submit_or_run(self.lane, self.value_gradient, minibatch)
        log_ratio = self.policy_gradient(minibatch)
        error = value_error()
        norm = torch.linalg.vector_norm(self.gradient)
        self.gradient.mul_((self.max_gradient_norm / (norm + 1e-6)).clamp_(max=1.0))
        self.optimizer.step()
        return log_ratio, error, norm[None]

    def policy_gradient(self, minibatch: Minibatch) -> Tensor:
        """Gradient of clipped policy loss - entropy_coefficient * entropy by policy and log_std; log ratios (N,).

        d min(r A, clip(r) A) / d log r = r A where that is the smaller one, 0 elsewhere; with e = (a - mean) / std,
        d log r / d mean = e / std,  d log r / d log_std = e^2 - 1,  d entropy / d log_std = 1.
        """
        tape = self.policy.kept_tape(len(minibatch.observations), "gradient")
        mean = self.policy.forward(minibatch.observations, tape)[0]
        inverse_std = torch.exp(-self.log_std)
        scaled = (minibatch.actions - mean) * inverse_std
        log_ratio = gaussian_log_probability(scaled, self.log_std) - minibatch.log_probabilities
        ratio = log_ratio.exp()
        gain = ratio * minibatch.advantages
        clipped = ratio.clamp(1.0 - self.clip_ratio, 1.0 + self.clip_ratio) * minibatch.advantages
        by_log_ratio = torch.where(gain <= clipped, gain, 0.0) / -len(gain)
        self.policy.backward((by_log_ratio[:, None] * scaled * inverse_std)[None], tape)
        torch.mv((scaled.square() - 1.0).T, by_log_ratio, out=self.log_std_gradient).sub_(self.entropy_coefficient)
        return log_ratio

    def value_gradient(self, minibatch: Minibatch) -> Tensor:
        """Gradient of value_coefficient * mean of (V - return)^2 / 2 by the value network; errors V - return (N,).

        With `value_clip` c and the value V' before the update the larger of that and ((V' + clip(V - V', -c, c)) -
        return)^2 / 2 counts: beyond the clip the latter has no gradient.
        """
        tape = self.value.kept_tape(len(minibatch.observations), "gradient")
        value = self.value.forward(minibatch.observations, tape)[0, :, 0]
        error = counted = value - minibatch.returns
        if self.value_clip is not None:
            moved = (value - minibatch.values).clamp_(-self.value_clip, self.value_clip)
            clipped = minibatch.values + moved - minibatch.returns
            outside = (value - minibatch.values).abs() > self.value_clip
            counted = torch.where(outside & (clipped.abs() > error.abs()), 0.0, error)
        self.value.backward(counted[None, :, None] * (self.value_coefficient / len(error)), tape)
        return error
