"""CMA-ES over controllers with a clock: periodic cycles of a gait on the native engine, in seconds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from romgrl.algorithms.divergence import check_physics
from romgrl.config.teachers import CMAESTeacher
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.metrics import GRAVITY
from romgrl.rom.gait_clocks import CLOCKS
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.parameters import standing_height
from romgrl.rom.phase_policy import COLUMNS, PhasePolicy, Span
from romgrl.stages.training.cycle_measures import Tries, TrySums

Array = NDArray[np.float64]


class Task(NamedTuple):
    """A speed, m/s, and an apex of jumps over the standing height, m (0: none), and worlds that are asked for them."""

    speed: float
    apex: float
    env: RomVectorEnv


LIMP_FREE = 0.08
"""Deviation of the times between touchdowns, share of their mean, that costs nothing."""
LEAST_KEPT = 0.05
"""Share of what a controller is paid that no price takes: falling is never cheaper."""
LEASH = 1e-4
"""What a controller loses by its squared distance from the first one, in deviations: where all fall, it decides."""
SHORTER = ((0.15, 4), (0.3, 2))
"""Until this share of the generations tries are shorter by this factor: what falls at once is sorted out cheaply."""
SLOPE = 0.5
"""First deviation of what a parameter grows by over half a span, share of the parameter's; its power for a power."""


class CycleSearch:
    """The search of a teacher: `generation` after `generation`, and the mean of what it has come to as a policy.

    tasks: each of population * rollouts worlds; all controllers are tried in each of them.
    """

    def __init__(self, teacher: CMAESTeacher, tasks: Sequence[Task], seed: int) -> None:
        self.teacher, self.tasks, self.seed = teacher, tasks, seed
        clock, parameters = CLOCKS[teacher.gait], tasks[0].env.parameters
        self.speed_unit = float(np.sqrt(GRAVITY * parameters.leg_length))
        self.power_unit = parameters.mass * GRAVITY * self.speed_unit
        self.standing = standing_height(parameters)
        self.spans = spans_of(teacher, self.speed_unit, parameters.leg_length)
        self.mean = np.concatenate([clock.mean, *(np.zeros(len(clock.mean)) for _ in self.spans)])
        self.deviation = np.concatenate(
            [clock.deviation, *(SLOPE**span.power * clock.deviation for span in self.spans)]
        )
        self.cma = CMA(
            mean=np.zeros(len(self.mean)), sigma=teacher.spread, population_size=teacher.population, seed=seed % 2**32
        )
        self.best = self.mean.copy()
        self.losses: list[Array] = []  # of each generation (population,)

    def generation(self, number: int) -> dict[str, float]:
        """Try a population and learn from it; what the best of it came to."""
        asked = np.array([self.cma.ask() for _ in range(self.teacher.population)])
        done = number / self.teacher.generations
        tries = self.tries(self.mean + self.deviation * asked, self.steps_of(done), self.seed + number)
        paid = self.paid(tries)
        lost = self.lost(tries) + LEASH * (asked**2).sum(axis=1)
        self.learn(asked, lost)
        first = int(np.argmin(lost))
        told = {"loss": lost[first], "reward": paid[:, first].mean(), "limp": tries.limp[:, first].mean()}
        told |= {"flight": tries.flight[:, first].mean(), "upright": tries.upright.mean()}
        return {name: float(value) for name, value in told.items()}

    def learn(self, asked: Array, lost: Array) -> None:
        """Learn from controllers (C, P), in deviations from the first one, and what they lose (C,)."""
        self.cma.tell([(each, float(loss)) for each, loss in zip(asked, lost, strict=True)])
        self.best = self.mean + self.deviation * self.cma.mean
        self.losses.append(lost)

    def learn_again(self, losses: Array) -> None:
        """Go through the generations whose losses (G, C) are known, without a try: the search is where it was."""
        for lost in losses:
            self.learn(np.array([self.cma.ask() for _ in lost]), lost)

    def steps_of(self, done: float) -> int:
        """How long tries are after a share of the search."""
        return self.teacher.search_steps // next((by for until, by in SHORTER if done < until), 1)

    def loss_of_mean(self) -> float:
        """What the mean loses in whole tries, in as many worlds as a generation has."""
        everyone = np.tile(self.best, (self.teacher.population, 1))
        return float(self.lost(self.tries(everyone, self.teacher.search_steps, self.seed)).mean())

    def lost(self, tries: Tries) -> Array:
        """What controllers lose (C,): 1 less what they earn and keep."""
        return np.asarray(1.0 - (self.paid(tries) * self.kept(tries)).mean(axis=(0, 2)))

    def paid(self, tries: Tries) -> Array:
        """What worlds earn by their mean speed, how it stays, and their apexes, the less the sooner they fall."""
        asked = np.array([task.speed for task in self.tasks])[:, None, None]
        off = self.teacher.alpha * np.abs(tries.speed - asked) + self.teacher.apex_alpha * tries.apex_error
        off += self.teacher.drift_alpha * tries.drift
        return np.asarray(tries.upright * np.exp(-off))

    def kept(self, tries: Tries) -> Array:
        """Which share of it they keep: what they limp, fly too much or too little for the gait, and work, costs."""
        least, most = FOOTFALLS[self.teacher.gait].flight
        wrong = np.maximum(tries.flight - most, 0.0) + np.maximum(least - tries.flight, 0.0)
        costs = self.teacher.limp_cost * np.maximum(tries.limp - LIMP_FREE, 0.0) + self.teacher.flight_cost * wrong
        costs += self.teacher.work_cost * tries.power / self.power_unit
        return np.asarray(np.clip(1.0 - costs, LEAST_KEPT, 1.0))

    def tries(self, parameters: Array, steps: int, seed: int) -> Tries:
        """Run each of the controllers (C, P) in its worlds of each task, (tasks, C, rollouts).

        DivergenceError where the physics diverges.
        """
        policy = self.policy(np.tile(np.repeat(parameters, self.teacher.rollouts, axis=0), (len(self.tasks), 1)))
        worlds = len(parameters) * self.teacher.rollouts
        observation = np.concatenate([task.env.reset(seed=seed)[0] for task in self.tasks])
        side, age = COLUMNS["last_touchdown_side"], COLUMNS["time_since_touchdown"]
        dt, second = self.tasks[0].env.dt, self.speed_unit / GRAVITY
        apex = self.standing + np.repeat([task.apex for task in self.tasks], worlds)
        sums = TrySums(observation[:, side], FOOTFALLS[self.teacher.gait].phase, steps, dt, apex)
        terminated = np.zeros(len(observation), bool)
        told = ("contact", "positive_power", "forward_velocity", "features")
        for step in range(steps):
            action, infos = policy(observation), []
            for place, task in enumerate(self.tasks):
                rows = slice(place * worlds, (place + 1) * worlds)
                observation[rows], _, terminated[rows], _, info = task.env.step(action[rows])
                check_physics(info["diverged"])
                infos.append(info)
            info = {name: np.concatenate([each[name] for each in infos]) for name in told}
            sums.add(step, observation[:, side], observation[:, age] * second, terminated, info)
        shape = len(self.tasks), len(parameters), self.teacher.rollouts
        done = Tries(*(values.reshape(shape) for values in sums.tries()))
        jumping = np.array([task.apex > 0 for task in self.tasks])[:, None, None]
        return done._replace(apex_error=done.apex_error * jumping)

    def policy(self, parameters: Array) -> PhasePolicy:
        """Controllers of these parameters, (P,) or (N, P)."""
        return PhasePolicy(parameters, self.teacher.gait, self.spans)

    def mean_policy(self) -> PhasePolicy:
        """The mean of the search."""
        return self.policy(self.best)

    def policy_vector(self) -> Array:
        """Its parameters (P,)."""
        return self.best.copy()

    def put_policy_vector(self, parameters: Array) -> None:
        """Take these for the best."""
        self.best = np.asarray(parameters, float)


def spans_of(teacher: CMAESTeacher, speed_unit: float, leg_length: float) -> list[Span]:
    """What the controllers of a teacher follow; speed_unit and leg_length, m/s and m: units of the observation."""
    spans, powers = [], range(1, teacher.degree + 1)
    if teacher.speeds is not None:
        low, high = teacher.speeds
        spans += [Span("target_speed", low / speed_unit, high / speed_unit, power) for power in powers]
    if teacher.stiffness_shares is not None:
        soft, stiff = teacher.stiffness_shares
        spans.append(Span("stiffness_share", soft, stiff))
    if teacher.apexes is not None:
        least, most = np.sqrt(2.0 * np.array(teacher.apexes) / leg_length).tolist()
        spans += [Span("target_takeoff_velocity", least, most, power) for power in powers]
    return [span for span in spans if span.high > span.low]
