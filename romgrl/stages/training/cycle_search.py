"""CMA-ES over controllers with a clock: periodic cycles of a gait on the native engine, in seconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from romgrl.algorithms.divergence import check_physics
from romgrl.config.teachers import CMAESTeacher
from romgrl.gait.metrics import GRAVITY
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.phase_policy import DEVIATION, MEAN, PhasePolicy

Array = NDArray[np.float64]

LIMP_FREE = 0.08
"""Deviation of the times between touchdowns, share of their mean, that costs nothing."""
LEASH = 2e-4
"""What a controller loses by its squared distance from the first one, in deviations: where all fall, it decides."""
SHORTER = ((0.15, 4), (0.3, 2))
"""Until this share of the generations tries are shorter by this factor: what falls at once is sorted out cheaply."""


class Tries(NamedTuple):
    """What controllers came to, each (C,), a mean over its worlds: reward per step, share of the steps before a fall,
    deviation of the times between touchdowns over their mean."""

    reward: Array
    upright: Array
    limp: Array


@dataclass
class TouchdownTimes:
    """The times between touchdowns of (N,) worlds, as sums: only one that follows another is counted."""

    side: Array
    last: Array
    count: Array
    total: Array
    squares: Array

    @classmethod
    def of(cls, side: Array) -> TouchdownTimes:
        """Before the first one."""
        return cls(side.copy(), np.full(len(side), np.nan), *(np.zeros(len(side)) for _ in range(3)))

    def add(self, side: Array, time: Array, counted: NDArray[np.bool_]) -> None:
        """Take in a step: the side of the last touchdown and when it was, s."""
        new = counted & (side != self.side)
        gap = np.where(new & np.isfinite(self.last), time - self.last, 0.0)
        self.count += gap > 0
        self.total += gap
        self.squares += gap**2
        self.last[new] = time[new]
        self.side[:] = side

    def spread(self) -> Array:
        """Deviation over mean; 0.5 where there are not two."""
        count = np.maximum(self.count, 1)
        mean = self.total / count
        deviation = np.sqrt(np.maximum(self.squares / count - mean**2, 0.0))
        return np.where(self.count >= 2, deviation / np.maximum(mean, 1e-9), 0.5)


class CycleSearch:
    """The search of a teacher: `generation` after `generation`, and the mean of what it has come to as a policy."""

    def __init__(self, teacher: CMAESTeacher, env: RomVectorEnv, seed: int) -> None:
        self.teacher, self.env, self.seed = teacher, env, seed
        self.cma = CMA(
            mean=np.zeros(len(MEAN)), sigma=teacher.spread, population_size=teacher.population, seed=seed % 2**32
        )
        self.best = MEAN.copy()
        names = list(env.observation_names)
        self._side, self._age = names.index("last_touchdown_side"), names.index("time_since_touchdown")
        self._time_unit = float(np.sqrt(env.parameters.leg_length / GRAVITY))

    def generation(self, number: int) -> dict[str, float]:
        """Try a population and learn from it; what the best of it came to."""
        asked = np.array([self.cma.ask() for _ in range(self.teacher.population)])
        tries = self.tries(MEAN + DEVIATION * asked, self.steps_of(number), self.seed + number)
        lost = self.losses(tries) + LEASH * (asked**2).sum(axis=1)
        self.cma.tell([(each, float(loss)) for each, loss in zip(asked, lost, strict=True)])
        self.best = MEAN + DEVIATION * self.cma.mean
        first = int(np.argmin(lost))
        told = {"loss": lost[first], "reward": tries.reward[first], "limp": tries.limp[first]}
        return {name: float(value) for name, value in told.items()} | {"upright": float(tries.upright.mean())}

    def steps_of(self, number: int) -> int:
        """How long the tries of a generation are."""
        done = number / self.teacher.generations
        return self.teacher.search_steps // next((by for until, by in SHORTER if done < until), 1)

    def losses(self, tries: Tries) -> Array:
        """What is made small: a lost share of the reward, and a limp of what walks."""
        limp = np.maximum(tries.limp - LIMP_FREE, 0.0)
        return 1.0 - tries.reward + self.teacher.limp_cost * np.maximum(tries.reward, 0.0) * limp

    def tries(self, parameters: Array, steps: int, seed: int) -> Tries:
        """Run each of the controllers (C, P) in its worlds; DivergenceError where the physics does."""
        env, worlds = self.env, len(parameters) * self.teacher.rollouts
        policy = PhasePolicy(np.repeat(parameters, self.teacher.rollouts, axis=0))
        observation, _ = env.reset(seed=seed)
        upright, reward, lasted = np.ones(worlds, bool), np.zeros(worlds), np.zeros(worlds)
        times = TouchdownTimes.of(observation[:, self._side])
        for step in range(steps):
            observation, paid, terminated, _, info = env.step(policy(observation))
            check_physics(info["diverged"])
            upright &= ~terminated
            reward += np.where(upright, paid, 0.0)
            lasted += upright
            now = (step + 1) * env.dt - observation[:, self._age] * self._time_unit
            times.add(observation[:, self._side], now, upright)
        each = (
            values.reshape(len(parameters), -1).mean(axis=1)
            for values in (reward / steps, lasted / steps, times.spread())
        )
        return Tries(*each)

    def mean_policy(self) -> PhasePolicy:
        """The mean of the search."""
        return PhasePolicy(self.best)

    def policy_vector(self) -> Array:
        """Its parameters (P,)."""
        return self.best.copy()

    def put_policy_vector(self, parameters: Array) -> None:
        """Take these for the best."""
        self.best = np.asarray(parameters, float)
