"""ROM-GRL (paper section 3.3): SAC whose reward comes from the discriminator.

By default it is recomputed with the current discriminator at every draw; `stored_reward` keeps the one of the step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from torch import Tensor

from romgrl.algorithms.discriminator import Discriminator
from romgrl.algorithms.networks.running_normalizer import RunningNormalizer
from romgrl.algorithms.replay_buffer import Batch, ReplayBuffer
from romgrl.algorithms.sac import SAC, Metrics
from romgrl.algorithms.second_thread import submit_or_run


@dataclass
class RomGrl:
    """What one update needs: the agent, its discriminator, its memory and the weight of the task reward."""

    sac: SAC
    discriminator: Discriminator | None
    buffer: ReplayBuffer
    normalizer: RunningNormalizer
    eta: float
    batch_size: int
    discriminator_interval: int
    discriminator_batch: int
    discriminator_recent: int | None
    stored_reward: bool = False
    stop_seen: bool = False
    discriminator_due: int = 0

    def update(self, count: int) -> Metrics:
        """Run `count` SAC updates with the discriminator as it is now; returns the last value of each metric."""
        drawn = self.draw(count * self.batch_size)
        self.normalizer.apply_(drawn.observation)
        self.normalizer.apply_(drawn.next_observation)
        reward, metrics = self._reward(drawn)
        for batch, share in zip(drawn.split(count), reward.chunk(count), strict=True):
            self.discriminator_due += self.sac.updates % self.discriminator_interval == 0
            metrics |= self.sac.update(batch, share)
        return metrics

    def draw(self, size: int) -> Batch:
        """So many transitions to learn from."""
        return self.buffer.sample(size)

    def start_discriminator(self) -> Callable[[], Metrics]:
        """Begin the discriminator's updates that are due, in the second lane where there is one.

        What it returns may be called again: the updates are done once.
        """
        discriminator, due, self.discriminator_due = self.discriminator, self.discriminator_due, 0
        if discriminator is None or discriminator.stopped or due == 0:
            return dict
        streams = self.buffer.sample_windows(due * self.discriminator_batch, self.discriminator_recent).chunk(due)
        return cache(submit_or_run(self.sac.lane, lambda: [discriminator.update(stream) for stream in streams][-1]))

    def collected_reward(self, windows: Tensor, updated: Callable[[], Metrics]) -> Tensor | float:
        """Imitation reward (N,) of a step's windows where rewards are stored, once the running update is through."""
        if self.discriminator is None or not self.stored_reward:
            return 0.0
        updated()
        return self.imitation(windows)

    def imitation(self, windows: Tensor) -> Tensor:
        """Imitation reward (N,) of windows with the discriminator as it is now, zeros without one."""
        windows = windows.to(self.buffer.windows.device)
        return windows.new_zeros(len(windows)) if self.discriminator is None else self.discriminator.reward(windows)

    def scale_learning_rates(self, scale: float) -> None:
        """Set all learning rates to their configured values times `scale`.

        The discriminator's as well: with one that learns fast and an agent that hardly does, a speed of 4.0 m/s fell to
        2.9 over the last tenth of a training.
        """
        optimizers = [self.sac.policy_optimizer, self.sac.critic_optimizer]
        if self.discriminator is not None:
            optimizers.append(self.discriminator.optimizer)
        for optimizer in optimizers:
            for group in optimizer.param_groups:
                group["lr"] = scale * group.setdefault("initial_lr", group["lr"])

    def measures(self, size: int) -> dict[str, float]:
        """How the discriminator tells the last `size` windows from the teacher's; nothing before it has learned."""
        if self.discriminator is None or self.discriminator.updates == 0:
            return {}
        return self.discriminator.measures(self.buffer.newest_windows(size))

    def counts(self) -> dict[str, float]:
        """How often each part was updated, and whether the discriminator has stopped (paper section 4.1.3)."""
        counts = {"updates": float(self.sac.updates)}
        if self.discriminator is not None:
            counts["discriminator_updates"] = float(self.discriminator.updates)
            counts["discriminator_stopped"] = float(self.discriminator.stopped)
        return counts

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs, but the rows of the buffer."""
        discriminator = {"discriminator": self.discriminator.state()} if self.discriminator is not None else {}
        own = {"stop_seen": self.stop_seen, "discriminator_due": self.discriminator_due, "eta": self.eta}
        return own | {name: part.state() for name, part in self._parts().items()} | discriminator

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.stop_seen, self.discriminator_due, self.eta = (
            state["stop_seen"],
            state["discriminator_due"],
            float(state["eta"]),
        )
        for name, part in self._parts().items():
            part.restore(state[name])
        if self.discriminator is not None:
            self.discriminator.restore(state["discriminator"])

    def _parts(self) -> dict[str, SAC | ReplayBuffer | RunningNormalizer]:
        return {"sac": self.sac, "buffer": self.buffer, "normalizer": self.normalizer}

    def just_stopped(self) -> bool:
        """True once, at the first call after the discriminator stopped."""
        seen, self.stop_seen = self.stop_seen, self.discriminator is not None and self.discriminator.stopped
        return self.stop_seen and not seen

    def task_weight(self, batch: Batch) -> Tensor | float:
        """Eta of the steps of a batch."""
        return self.eta

    def _reward(self, batch: Batch) -> tuple[Tensor, Metrics]:
        """Sum of gamma^k r_k over the steps that count, (B,), with r = eta r_env + (1 - eta) r_im (paper, J(pi)) and
        the discriminator as it is now."""
        weights = batch.counts * self.sac.gamma**self.buffer.ahead
        if self.discriminator is None:
            return (weights * self.eta * batch.task_reward).sum(1), {"task_reward": batch.task_reward.mean()}
        imitation = batch.imitation_reward
        if not self.stored_reward:
            imitation = self.discriminator.reward(batch.windows.flatten(0, 1)).view_as(imitation)
        eta = self.task_weight(batch)
        reward = eta * batch.task_reward + (1 - eta) * imitation
        share = (1 - self.eta) * imitation.mean() / reward.mean().clamp(min=1e-6)
        return (weights * reward).sum(1), {
            "task_reward": batch.task_reward.mean(),
            "imitation_reward": imitation.mean(),
            "imitation_share": share,
        }
