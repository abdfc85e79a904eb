"""The replay buffer returns transitions that happened, and nothing else."""

from itertools import product
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from romgrl.algorithms.replay_buffer import ReplayBuffer
from romgrl.gait.discriminator_windows import FrameWindows, WindowLayout, reference_windows
from romgrl.gait.symmetry import Mirror


def fill(buffer: ReplayBuffer, steps: int, truncated_every: int = 0) -> None:
    """Observation (env, time): its successor must be (env, time + 1)."""
    envs = torch.arange(buffer.num_envs, dtype=torch.float32)
    for t in range(steps):
        now = torch.stack((envs, torch.full_like(envs, t)), -1)
        following = torch.stack((envs, torch.full_like(envs, t + 1)), -1)
        truncated = torch.full((buffer.num_envs,), bool(truncated_every and t % truncated_every == 0))
        buffer.add(now, now[:, :1] * 100 + t, following, envs + t, torch.zeros(len(envs)), truncated, now)


def make(capacity: int, **settings: Any) -> ReplayBuffer:
    return ReplayBuffer(
        capacity=capacity, num_envs=4, observation_size=2, action_size=1, window_size=2, seed=0, **settings
    )


@pytest.mark.parametrize("steps", [3, 10, 16, 17, 40, 100])
def test_transitions_belong_together(steps: int) -> None:
    """Before and after the ring wraps."""
    buffer = make(64)
    fill(buffer, steps)
    batch = buffer.sample(2000)
    env, time = batch.observation.T
    torch.testing.assert_close(batch.next_observation, torch.stack((env, time + 1), -1))
    torch.testing.assert_close(batch.action[:, 0], env * 100 + time)
    torch.testing.assert_close(batch.task_reward[:, 0], env + time)
    torch.testing.assert_close(batch.windows[:, 0], batch.observation)
    assert set(env.tolist()) == {0.0, 1.0, 2.0, 3.0}
    assert len(set(time.tolist())) == len(buffer) // 4


@pytest.mark.parametrize("steps", [10, 40])
def test_steps_in_a_row_end_with_a_fall_a_truncation_and_the_newest_step(steps: int) -> None:
    """Against the story told step by step; env 1 falls every fifth step, env 2 is truncated every sixth."""
    buffer = make(64, n_steps=3)
    for t in range(steps):
        now, envs = torch.tensor([[env, t] for env in range(4)], dtype=torch.float32), torch.arange(4)
        fell, cut = (envs == 1) & (t % 5 == 4), (envs == 2) & (t % 6 == 5)
        following = now + torch.tensor([0.0, 1.0])
        buffer.add(now, now[:, :1], following, 10.0 * t + envs, fell.float(), cut, now, 100.0 * t + envs)
    batch = buffer.sample(3000)
    for row in range(3000):
        env, start = (int(value) for value in batch.observation[row])
        last = start
        while last < start + 2 and last < steps - 1 and not (env == 1 and last % 5 == 4):
            if env == 2 and (last + 1) % 6 == 5:
                break
            last += 1
        count = last - start + 1
        assert batch.counts[row].tolist() == [1.0] * count + [0.0] * (3 - count)
        assert batch.next_observation[row].tolist() == [env, last + 1]
        assert float(batch.terminated[row]) == (env == 1 and last % 5 == 4)
        times = torch.arange(start, last + 1, dtype=torch.float32)
        torch.testing.assert_close(batch.task_reward[row, :count], 10 * times + env)
        torch.testing.assert_close(batch.imitation_reward[row, :count], 100 * times + env)
        torch.testing.assert_close(batch.windows[row, :count, 1], times)
    assert {int(count) for count in batch.counts.sum(1)} == {1, 2, 3}


def test_truncated_transitions_are_never_drawn() -> None:
    buffer = make(400)
    fill(buffer, 300, truncated_every=7)
    assert (buffer.sample(5000).observation[:, 1] % 7 != 0).all()


def test_recent_frames() -> None:
    buffer = make(400)
    fill(buffer, 90)
    frames = buffer.sample_windows(1000, recent=40)
    assert frames[:, 1].min() == 80
    assert frames[:, 1].max() == 89


def test_every_second_transition_is_mirrored() -> None:
    mirror = Mirror(np.array([0, 1]), np.array([-1.0, 1.0], np.float32))
    buffer = make(64, mirror_observation=mirror)
    fill(buffer, 12)
    batch = buffer.sample(60)
    assert (batch.observation[::2, 0] <= 0).all()
    assert (batch.observation[1::2, 0] >= 0).all()
    torch.testing.assert_close(batch.next_observation[:, 0], batch.observation[:, 0])
    assert (batch.action >= 0).all()


def test_all_windows_of_a_mirrored_return_are_mirrored() -> None:
    buffer = make(64, n_steps=2, mirror_windows=Mirror(np.array([1, 0]), np.array([1.0, -1.0], np.float32)))
    fill(buffer, 12)
    batch = buffer.sample(60)
    env, time = batch.observation.T
    for step in range(2):
        there = batch.counts[:, step] > 0
        windows, shown = batch.windows[:, step], torch.stack((env, time + step), -1)
        mirrored = torch.stack((time + step, -env), -1)
        torch.testing.assert_close(windows[::2][there[::2]], mirrored[::2][there[::2]])
        torch.testing.assert_close(windows[1::2][there[1::2]], shown[1::2][there[1::2]])


def test_too_small_and_empty_buffers_are_refused() -> None:
    with pytest.raises(ValueError, match="capacity"):
        make(8)
    with pytest.raises(ValueError, match="empty"):
        make(64).sample(1)


def test_windows_hold_the_last_frames_and_restart() -> None:
    windows = FrameWindows(num_envs=2, layout=WindowLayout("paper", window=3))

    def frame(value: float) -> NDArray[np.float32]:
        return np.full((2, 5), value, dtype=np.float32)

    windows.restart(frame(0))
    windows.push(frame(1))
    np.testing.assert_array_equal(windows.push(frame(2))[:, ::5], [[0, 1, 2]] * 2)
    windows.restart(frame(9), np.array([True, False]))
    np.testing.assert_array_equal(windows.push(frame(10))[:, ::5], [[9, 9, 10], [1, 2, 10]])


def test_reference_windows_stay_within_episodes() -> None:
    features = np.arange(10, dtype=np.float32)[:, None] * np.ones(5, dtype=np.float32)
    episode = np.array([0] * 6 + [1] * 4, dtype=np.int32)
    windows = reference_windows(features, episode, layout=WindowLayout("paper", 3), trunk_std=0, mirror=False, seed=0)
    first = windows.reshape(-1, 3, 5)[:, :, 0]
    np.testing.assert_array_equal(first[:, 0], [0, 1, 2, 3, 6, 7])
    np.testing.assert_array_equal(np.diff(first, axis=1), 1)


def test_reference_windows_carry_one_trunk_inclination_each_and_their_mirror() -> None:
    features = np.tile(np.array([0.9, 0.1, -0.8, 0.3, -0.7], dtype=np.float32), (500, 1))
    episode = np.zeros(500, dtype=np.int32)
    windows = reference_windows(features, episode, layout=WindowLayout("trunk", 2), trunk_std=0.1, mirror=True, seed=0)
    assert windows.shape == (998, 12)
    frames = windows.reshape(-1, 2, 6)
    np.testing.assert_array_equal(frames[:, 0, 5], frames[:, 1, 5])
    assert frames[::2, 0, 5].std() == pytest.approx(0.1, rel=0.15)
    np.testing.assert_allclose(frames[1, 0, :5], [0.9, 0.3, -0.7, 0.1, -0.8], atol=1e-7)


def test_windows_longer_than_every_episode_are_refused() -> None:
    with pytest.raises(ValueError, match="no episode"):
        reference_windows(
            np.zeros((4, 5), np.float32),
            np.arange(4, dtype=np.int32),
            layout=WindowLayout("paper", 2),
            trunk_std=0,
            mirror=False,
            seed=0,
        )


RINGS = list(product((4, 5), (1, 2), product((False, True), repeat=7)))


def test_no_truncated_transition_is_drawn_whatever_was_truncated() -> None:
    """Every pattern of truncations of one environment beside its mirror image, in rings that wrap around."""
    for rows, num_envs, pattern in RINGS:
        buffer, flags = small(rows, num_envs), torch.tensor([pattern, pattern[::-1]]).T[:, :num_envs]
        for step, truncated in enumerate(flags):
            put(buffer, step, truncated)
            held = flags[max(0, step + 2 - rows) : step + 1]
            if step < 2:
                continue
            if held.all():
                with pytest.raises(ValueError, match="truncated"):
                    buffer.sample(1)
                continue
            batch = buffer.sample(60)
            env, time = batch.observation.long().T
            assert not flags[time, env].any()
            assert time.min() > step + 1 - rows  # the ring holds it and its successor
            assert torch.equal(batch.next_observation[:, 1], batch.observation[:, 1] + 1)


def test_draws_are_those_of_old_where_no_two_truncations_follow_each_other() -> None:
    """One before stands in for a truncated transition, so that trainings give the same bits as ever."""
    for rows, num_envs, pattern in RINGS:
        flags = torch.tensor([pattern, pattern[::-1]]).T[:, :num_envs]
        if (flags[1:] & flags[:-1]).any():
            continue
        buffer, twin = small(rows, num_envs), torch.Generator().manual_seed(0)
        for step, truncated in enumerate(flags):
            put(buffer, step, truncated)
        recent = min(len(flags), rows - 1) - 1
        offset = torch.randint(recent * num_envs, (50,), generator=twin)
        time, env = len(flags) - 1 - offset // num_envs, num_envs - 1 - offset % num_envs
        expected = torch.stack((env, time - flags[time, env].long()), -1)
        assert torch.equal(buffer.sample(50).observation.long(), expected)


def test_a_fall_in_the_last_step_of_an_episode_is_drawn() -> None:
    """It has no successor that matters, so nothing is missing."""
    buffer = small(5, 1)
    for step in range(3):
        put(buffer, step, torch.tensor([True]), terminated=float(step == 2))
    batch = buffer.sample(20)
    assert set(batch.observation[:, 1].tolist()) == {2.0}
    assert batch.terminated.all()


def test_a_ring_that_was_put_back_draws_the_same() -> None:
    """With truncations in a row, before and after it wraps."""
    for steps in (3, 4, 9):
        buffer, other = small(5, 2), small(5, 2)
        for step in range(steps):
            put(buffer, step, torch.tensor([step % 4 > 1, step % 4 > 0]))
        first = max(0, steps - 5)
        other.write_rows(first, buffer.read_rows(first, steps))
        other.restore(buffer.state())
        for ring in (buffer, other):
            put(ring, steps, torch.tensor([True, True]))
        assert torch.equal(buffer.sample(40).observation, other.sample(40).observation)


def small(rows: int, num_envs: int) -> ReplayBuffer:
    return ReplayBuffer(
        capacity=rows * num_envs, num_envs=num_envs, observation_size=2, action_size=1, window_size=2, seed=0
    )


def put(buffer: ReplayBuffer, step: int, truncated: Tensor, terminated: float = 0.0) -> None:
    """Add the observations (env, step), which lead to (env, step + 1)."""
    envs = torch.arange(buffer.num_envs, dtype=torch.float32)
    now, following = (torch.stack((envs, torch.full_like(envs, time)), -1) for time in (step, step + 1))
    buffer.add(now, now[:, :1], following, envs, torch.full_like(envs, terminated), truncated, now)
