"""Replay buffer of the student: time-major rings, next observations by index, windows of the gait beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from romgrl.gait.symmetry import Mirror


@dataclass
class Batch:
    """B transitions drawn from the buffer, with what the n steps from each on were paid for."""

    observation: Tensor  # (B, observation_size)
    action: Tensor  # (B, action_size)
    next_observation: Tensor  # (B, observation_size) after the last step that counts
    terminated: Tensor  # (B,) 1 where the episode ended in a fall by then
    counts: Tensor  # (B, n) 1 for the steps that count: up to a fall, a truncation or the newest step; the first does
    task_reward: Tensor  # (B, n)
    windows: Tensor  # (B, n, window_size) window of gait features after each step
    imitation_reward: Tensor  # (B, n) as stored when the step was taken

    def split(self, parts: int) -> list[Batch]:
        """Cut into `parts` batches of equal size (views, no copies)."""
        columns = zip(*(value.chunk(parts) for value in vars(self).values()), strict=True)
        return [Batch(*column) for column in columns]


class ReplayBuffer:
    """Ring of the last `capacity` transitions of `num_envs` environments.

    The successor of a transition is the next row of the ring. A fallen episode has no successor that matters
    (its value is zero), and a truncated transition is not sampled, because its successor is not stored: the last one
    before it that was not truncated takes its place, or the newest of all where the ring does not hold that any more.
    `n_steps` steps in a row are drawn at once.
    """

    def __init__(
        self,
        *,
        capacity: int,
        num_envs: int,
        observation_size: int,
        action_size: int,
        window_size: int,
        seed: int,
        n_steps: int = 1,
        device: str = "cpu",
        mirror_observation: Mirror | None = None,
        mirror_action: Mirror | None = None,
        mirror_windows: Mirror | None = None,
    ) -> None:
        if capacity < 4 * num_envs:
            raise ValueError(f"capacity {capacity} holds fewer than 4 steps of {num_envs} environments")
        self.rows = capacity // num_envs
        self.ahead = torch.arange(n_steps, device=device)
        self.num_envs = num_envs
        shape = (self.rows, num_envs)
        self.observation = torch.zeros((*shape, observation_size), device=device)
        self.action = torch.zeros((*shape, action_size), device=device)
        self.windows = torch.zeros((*shape, window_size), device=device)
        self.task_reward = torch.zeros(shape, device=device)
        self.imitation_reward = torch.zeros(shape, device=device)
        self.terminated = torch.zeros(shape, device=device)
        self.back = torch.zeros(shape, dtype=torch.int32, device=device)
        """Steps back to the last transition of the same environment that was not truncated; 0: this one."""
        self.newest = torch.zeros(1, dtype=torch.int64, device=device)
        """Flat index of a transition of the last step in which an environment was not truncated."""
        self.usable = 0  # steps that were added up to that one
        given = (mirror_observation, mirror_action, mirror_windows)
        self.mirrors = [mirror and mirror.tensors(device) for mirror in given]
        self.generator = torch.Generator(device=device).manual_seed(seed)
        self.added = 0

    def __len__(self) -> int:
        """Transitions that can be sampled."""
        return max(0, min(self.added, self.rows - 1) - 1) * self.num_envs

    def add(
        self,
        observation: Tensor,
        action: Tensor,
        next_observation: Tensor,
        task_reward: Tensor,
        terminated: Tensor,
        truncated: Tensor,
        windows: Tensor,
        imitation_reward: Tensor | float = 0.0,
    ) -> None:
        """Store one step of all environments; `next_observation` is the one after any reset.

        `terminated` and `truncated` come from the environments, so asking whether all are truncated stops no device.
        """
        row = self.added % self.rows
        self.observation[row] = observation
        self.action[row] = action
        self.task_reward[row] = task_reward
        self.terminated[row] = terminated
        cut = truncated.bool() & ~terminated.bool()  # a fall needs no successor
        self.back[row] = (self.back[row - 1] + 1) * cut.to(self.back.device)
        self.windows[row] = windows
        self.imitation_reward[row] = imitation_reward
        self.observation[(row + 1) % self.rows] = next_observation
        self.added += 1
        if not cut.all():
            self.usable = self.added
            self._find_newest()

    def sample(self, size: int) -> Batch:
        """Draw `size` transitions with replacement; every second one is mirrored where mirrors were given."""
        index = self._draw(size, min(self.added, self.rows - 1) - 1)
        path = (index.unsqueeze(1) + self.ahead * self.num_envs) % (self.rows * self.num_envs)
        fell, counts = self._counts(path)
        last = path.gather(1, counts.sum(1, keepdim=True).long() - 1).squeeze(1)
        batch = Batch(
            observation=_rows(self.observation, index),
            action=_rows(self.action, index),
            next_observation=_rows(self.observation, (last + self.num_envs) % (self.rows * self.num_envs)),
            terminated=(fell * counts).sum(1),
            counts=counts,
            task_reward=_rows(self.task_reward, path),
            windows=_rows(self.windows, path),
            imitation_reward=_rows(self.imitation_reward, path),
        )
        observation, action, windows = self.mirrors
        mirror_half(batch.observation, observation)
        mirror_half(batch.next_observation, observation)
        mirror_half(batch.action, action)
        mirror_half(batch.windows, windows)
        return batch

    def _counts(self, path: Tensor) -> tuple[Tensor, Tensor]:
        """Of n steps in a row at flat indices (B, n): where a fall ended the episode, and which of them count."""
        fell = _rows(self.terminated, path)
        left = ((self.added - 1) % self.rows - path[:, :1] // self.num_envs) % self.rows
        counts = ((_rows(self.back, path) == 0) & (self.ahead <= left)).to(fell.dtype)
        counts[:, 0] = 1.0  # as `_draw` chose it
        counts[:, 1:] *= 1 - fell[:, :-1]
        return fell, counts.cumprod(1)

    def sample_windows(self, size: int, recent: int | None = None) -> Tensor:
        """Draw windows of gait features, (size, window_size), from the last `recent` transitions (None: all)."""
        rows = min(self.added, self.rows - 1) - 1
        if recent is not None:
            rows = min(rows, max(1, recent // self.num_envs))
        windows = _rows(self.windows, self._draw(size, rows))
        mirror_half(windows, self.mirrors[2])
        return windows

    def newest_windows(self, size: int) -> Tensor:
        """The last windows of gait features, (at most `size`, window_size), as they were stored."""
        count = min(self.added, self.rows, max(1, size // self.num_envs))
        index = torch.arange(self.added - count, self.added, device=self.windows.device) % self.rows
        return self.windows.index_select(0, index).flatten(0, 1)

    def state(self) -> dict[str, Any]:
        """Everything but the rows: counters, random stream, and the observation that the newest row led to."""
        counters = {"added": self.added, "usable": self.usable}
        following = self.observation[self.added % self.rows]
        return counters | {"generator": self.generator.get_state(), "following": following}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state, the rows of which `write_rows` has put back."""
        self.added, self.usable = state["added"], state["usable"]
        self._find_newest()
        self.generator.set_state(state["generator"])
        self.observation[self.added % self.rows] = state["following"]

    def read_rows(self, first: int, last: int) -> dict[str, Tensor]:
        """Copies of the steps first ... last - 1 of all that were added; the ring must still hold them."""
        index = torch.arange(first, last, device=self.task_reward.device) % self.rows
        return {name: ring.index_select(0, index) for name, ring in self._rings().items()}

    def write_rows(self, first: int, columns: Mapping[str, Tensor]) -> None:
        """Put back what `read_rows` returned."""
        for name, ring in self._rings().items():
            rows = columns[name].to(ring.device)
            index = torch.arange(first, first + len(rows), device=ring.device) % self.rows
            ring.index_copy_(0, index, rows)

    def _find_newest(self) -> None:
        """Point to the newest transition that was not truncated, in the last row that has one."""
        row = (self.usable - 1) % self.rows
        self.newest[0] = self.back[row].argmin() + row * self.num_envs

    def _rings(self) -> dict[str, Tensor]:
        return {
            "observation": self.observation,
            "action": self.action,
            "windows": self.windows,
            "task_reward": self.task_reward,
            "imitation_reward": self.imitation_reward,
            "terminated": self.terminated,
            "back": self.back,
        }

    def _draw(self, size: int, rows: int) -> Tensor:
        """Flat indices of transitions among the last `rows` rows, each truncated one replaced by one that is not.

        Raises ValueError where the ring holds no other.
        """
        if rows < 1:
            raise ValueError("the replay buffer is empty")
        held = min(self.added, self.rows - 1)
        if self.added - self.usable >= held:
            raise ValueError("every transition of the replay buffer is truncated: there is nothing to learn from")
        offset = torch.randint(rows * self.num_envs, (size,), generator=self.generator, device=self.task_reward.device)
        capacity = self.rows * self.num_envs
        last = (self.added - 1) % self.rows * self.num_envs + self.num_envs - 1
        offset.add_(_rows(self.back, (last - offset) % capacity), alpha=self.num_envs)
        return torch.where(offset < held * self.num_envs, (last - offset) % capacity, self.newest)


def _rows(ring: Tensor, index: Tensor) -> Tensor:
    # index_select: a sixth of the time of ring[index]
    flat = ring.flatten(0, 1)
    return flat.index_select(0, index.flatten()).view(*index.shape, *flat.shape[1:])


def mirror_half(values: Tensor, mirror: Mirror | None) -> None:
    """Exchange left and right in every second row (B, columns), in place; None: in none."""
    if mirror is not None:
        torch.mul(values[::2].index_select(-1, mirror.permutation), mirror.sign, out=values[::2])
