"""A policy's episodes become a gait, whatever the worlds report."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.recording import record


class Counting:
    """Three worlds that report their step in arrays that they reuse; the second falls at step 4."""

    num_envs = 3

    def __init__(self, **others: NDArray[Any]) -> None:
        self.seeds: list[int] = []
        self.info = {"features": np.zeros((3, 5), np.float32), "forward_velocity": np.zeros(3, np.float32)} | others

    def reset(self, *, seed: int) -> tuple[NDArray[np.float32], dict[str, Any]]:
        self.seeds.append(seed)
        self.now = 0
        return np.zeros((3, 2), np.float32), {}

    def step(self, actions: NDArray[np.float32], /) -> tuple[Any, ...]:
        assert actions.tolist() == [[self.now]] * 3
        for values in self.info.values():
            values[:] = self.now % 2 if values.dtype == bool else self.now
        self.now += 1
        observation = np.full((3, 2), self.now, np.float32)
        return observation, np.zeros(3), np.array([False, self.now == 5, False]), np.zeros(3, bool), self.info


def policy(observation: NDArray[np.float32]) -> NDArray[np.float32]:
    return observation[:, :1]


def test_each_step_is_kept_and_nothing_counts_from_a_fall_on() -> None:
    worlds = Counting()
    gait = record(worlds, policy, steps=7, seed=11, dt=0.1)
    assert worlds.seeds == [11]
    assert gait.velocity is not None
    assert gait.velocity.tolist() == [list(range(7))] * 3
    assert (gait.features[..., 4] == gait.velocity).all()
    assert gait.valid.sum(axis=1).tolist() == [7, 4, 7]
    assert gait.fallen.tolist() == [False, True, False]
    assert gait.dt == 0.1


def test_what_worlds_do_not_report_is_not_there() -> None:
    bare = record(Counting(), policy, steps=3, seed=0, dt=0.1)
    assert bare.contact is None
    assert bare.trunk_lean is None
    assert bare.power is None
    contact, lean = np.zeros((3, 2), bool), np.zeros(3, np.float32)
    power = {"power": np.zeros(3, np.float32), "retraction_power": np.zeros(3, np.float32)}
    told = record(Counting(contact=contact, trunk_lean=lean, **power), policy, steps=3, seed=0, dt=0.1)
    assert told.contact is not None
    assert told.trunk_lean is not None
    assert (told.contact.dtype, told.contact[0, :, 1].tolist()) == (bool, [False, True, False])
    assert told.trunk_lean[2] == pytest.approx([0, 1, 2])
    assert told.power is not None
    assert told.retraction_power is not None
    assert told.power[1].tolist() == told.retraction_power[1].tolist() == [0, 1, 2]
    assert told.positive_power is None
