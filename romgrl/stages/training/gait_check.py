"""What a student's gait is while it learns: rolled out at intervals, beside the teacher's; the best policy is kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from romgrl.algorithms.networks.stacked_mlp import StackedMLP
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import Mirrors, SACPolicy
from romgrl.config.schema import Config
from romgrl.gait.alignment import error_over_variance
from romgrl.gait.features import Gait, gait_from_reference
from romgrl.gait.metrics import describe
from romgrl.gait.recording import record
from romgrl.humanoid.task import speed_reward
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.adapted_eta import (
    ADAPTS_FROM,
    CADENCE,
    LATE_FROM,
    SECOND_ETA,
    SPEED,
    STANDING,
    adapted,
    another_stride,
    least_eta,
)
from romgrl.stages.training.budget import Budget
from romgrl.stages.wiring.humanoid import humanoid_env, speed_sensitivity
from romgrl.stages.wiring.imitated import read_imitated
from romgrl.stages.wiring.seeds import CHECK_SEED

EPISODES, STEPS, LONGEST_WINDOW = 16, 300, 100
FILE = "checks.csv"
PASSES = 2  # checks in a row after which the gait is the teacher's
STATUE = 1.0  # error over variance of the teacher's mean pose
LEAN = 10.0
"""What a student passes with all episodes upright: speed and cadence within SPEED and CADENCE percent of what is asked
and of the teacher's, trunk lean within so many degrees of upright."""


def shortcomings(row: Mapping[str, float]) -> list[str]:
    """What a student of a row of checks.csv lacks to run as its teacher does; empty where it passes."""
    if row["falls"]:
        return [f"falls in {row['falls']:.0f} of {EPISODES} episodes"]
    found = []
    if not abs(row["speed_error_percent"]) <= SPEED:
        found.append(f"wrong speed, {row['speed_error_percent']:+.1f} %")
    if not abs(row["cadence_error_percent"]) <= CADENCE:
        found.append(f"wrong cadence, {row['cadence_error_percent']:+.1f} %")
    if not abs(row["trunk_lean_deg"]) <= LEAN:
        found.append(f"leans by {row['trunk_lean_deg']:.0f} degrees")
    return found


@dataclass
class GaitChecks:
    """Checks of the averaged policy every `interval` steps (0: none) of a training; the best policy is kept.

    It is rolled out in `env` and compared with `teacher`; where there is none, as for a baseline, its reward counts.
    """

    interval: int
    config: Config
    env: PlanarHumanoidVectorEnv | None
    teacher: Gait | None
    columns: Tensor
    mirrors: Mirrors | None
    output: Path
    log: StageLog
    rows: list[dict[str, float]] = field(default_factory=list)
    best: list[Tensor] = field(default_factory=list)
    """Weights of the best policy, mean and scale of its observations; empty before the first check."""

    @classmethod
    def of(
        cls,
        config: Config,
        reference: Path | None,
        columns: Tensor,
        mirrors: Mirrors | None,
        output: Path,
        log: StageLog,
    ) -> GaitChecks:
        """Those of a configuration; reference: of a student."""
        interval = config.student.check_steps
        env = humanoid_env(config, num_envs=EPISODES, episode_steps=STEPS + 1) if interval else None
        taught = reference is not None and config.discriminator.enabled
        teacher = gait_from_reference(read_imitated(reference, config, steps=2)) if taught and reference else None
        return cls(interval, config, env, teacher, columns, mirrors, output, log)

    @cached_property
    def taught(self) -> dict[str, float]:
        """The teacher's gait in numbers; none of a baseline's."""
        return {} if self.teacher is None else describe(self.teacher, target_speed=self.config.speed)

    def check_if_due(self, step: int, learner: RomGrl, budget: Budget) -> None:
        """Check the policy where `step` has reached a multiple of the interval that no row has yet, and at the end.

        What is found may change the weight of the task, and what is left of the budget.
        """
        if self.env is None or (step // self.interval <= len(self.rows) and not budget.reached(step)):
            return
        policy, weights = averaged_policy(learner, self.columns, self.mirrors)
        seed = self.config.seed + CHECK_SEED
        measured = self.measure(record(self.env, policy, steps=STEPS, seed=seed, dt=self.env.control_step))
        row = {"step": float(step), "eta": float(learner.eta)} | {
            name: float(value) for name, value in measured.items()
        }
        self.rows.append(row)
        if self.kept is row:
            self.best = weights
        if budget.reached(step, 0.5):
            self.tell(row)
        adapts = self.config.student.adapt_eta and self.teacher is not None and self.config.eta < 1
        if adapts and budget.reached(step, ADAPTS_FROM) and not budget.again:
            new = adapted(learner.eta, row, fell=row["falls"] > EPISODES / 4)
            learner.eta = max(least_eta(self.config.eta, budget.share(step)), new)
        pd.DataFrame(self.rows).to_csv(self.output / FILE, index=False)
        if self.is_lost(step, budget):
            budget.go_back(step, ADAPTS_FROM)
            learner.eta = min(SECOND_ETA, self.config.eta)
            self.log.message(
                f"gait at step {step:,.0f}: it falls, or is no nearer to the teacher's than a statue; {budget.again:,} "
                f"steps are made again, to {budget.end:,}"
            )
        if self.config.student.end_early and self.passes() >= PASSES and not budget.reached(step, 0.5):
            budget.begin_second_half(step)
            self.log.message(f"{PASSES} checks in a row passed: the second half begins, to {budget.end:,} steps")

    def is_lost(self, step: int, budget: Budget) -> bool:
        """Tell whether a student late in a training, for the first time, is one that what is left would not change.

        It has passed no check, and falls in most episodes or is no nearer to its teacher than a statue, in another
        stride, without one, or standing: the weight of its speed has risen, and learning rates fall.
        """
        if not (self.config.student.second_try and self.teacher is not None and self.config.eta < 1):
            return False
        late = budget.minutes is None and budget.again == 0 and budget.reached(step, LATE_FROM)
        if not late or any(row["passed"] for row in self.rows):
            return False
        row = self.rows[-1]
        elsewhere = another_stride(row) or row["speed_error_percent"] < -STANDING
        return row["falls"] > EPISODES / 2 or (elsewhere and not row["error_over_variance"] < STATUE)

    def tell(self, row: Mapping[str, float]) -> None:
        """Say what is wrong with the gait of a student that does not fall."""
        if "passed" in row and not row["falls"]:
            told = "; ".join(shortcomings(row)) or "passed"
            self.log.message(
                f"gait at step {row['step']:,.0f}: {told}; error over variance {row['error_over_variance']:.2f}"
            )

    def measure(self, gait: Gait) -> dict[str, float]:
        """A row of checks.csv."""
        assert gait.velocity is not None
        speed = self.config.speed
        row = describe(gait, target_speed=speed)
        reward = speed_reward(gait.velocity, speed=speed, alpha=speed_sensitivity(self.config))
        kept = ("falls", "steady_speed_m_per_s", "stride_frequency_hz", "pelvis_excursion_m", "trunk_lean_deg")
        measured = {"task_reward": float((reward * gait.valid).mean()), **{name: row[name] for name in kept}}
        measured["speed_error_percent"] = percent(row["steady_speed_m_per_s"], speed) - 100
        if self.teacher is None:
            return measured
        taught, window = self.taught, min(LONGEST_WINDOW, int(self.teacher.valid.sum(axis=1).min()))
        measured["cadence_error_percent"] = percent(row["stride_frequency_hz"], taught["stride_frequency_hz"]) - 100
        measured["excursion_percent"] = percent(row["pelvis_excursion_m"], taught["pelvis_excursion_m"])
        measured["error_over_variance"] = float(error_over_variance(gait, self.teacher, window).mean())
        return measured | {"passed": float(not shortcomings(measured))}

    @property
    def kept(self) -> dict[str, float]:
        """The check whose policy is kept: `student.kept_policy`."""
        kept = self.config.student.kept_policy
        return self.rows[-1] if kept == "last" else min(self.rows, key=lambda row: rank(row, kept))

    def passes(self) -> int:
        """Checks in a row that the policy has passed, up to the last one."""
        count = 0
        for row in reversed(self.rows):
            if row.get("passed", 0.0) == 0.0:
                break
            count += 1
        return count

    def keep_best(self, learner: RomGrl) -> tuple[Tensor, Tensor]:
        """Give the averaged policy of the agent the best weights; mean and scale of its observations."""
        if self.best:
            best = self.kept
            told = f"falls in {best['falls']:.0f} of {EPISODES} episodes, {best['steady_speed_m_per_s']:.2f} m/s"
            if self.teacher is not None:
                told += f", error over variance {best['error_over_variance']:.2f}"
            self.log.message(f"kept the policy of step {best['step']:,.0f}: {told}")
        return give_best(self.best, self.env, learner)

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        return {"rows": [list(row.values()) for row in self.rows], "names": list(self.rows[0]) if self.rows else []} | (
            dict(zip(("weights", "mean", "scale"), self.best, strict=True)) if self.best else {}
        )

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.rows = [dict(zip(state["names"], map(float, row), strict=True)) for row in state["rows"]]
        self.best = [torch.as_tensor(state[name]) for name in ("weights", "mean", "scale")] if self.rows else []


def averaged_policy(learner: RomGrl, columns: Tensor, mirrors: Mirrors | None) -> tuple[SACPolicy, list[Tensor]]:
    """The averaged policy as it is now, on the processor; its weights, mean and scale of its observations."""
    moments = learner.normalizer.mean_and_scale()
    with torch.random.fork_rng(devices=[]):  # the weights drawn here are no part of the training
        network = StackedMLP(stack=1, **learner.sac.network)
    network.flat.copy_(learner.sac.average.flat)
    policy = SACPolicy(network, columns, *(part.cpu() for part in moments), mirrors=mirrors)
    return policy, [network.flat, *moments]


def give_best(best: list[Tensor], env: PlanarHumanoidVectorEnv | None, learner: RomGrl) -> tuple[Tensor, Tensor]:
    """End the checks in `env`: the averaged policy gets the best weights; mean and scale of its observations.

    best: weights, mean and scale; empty where nothing was checked, which changes no weight.
    """
    if env is not None:
        env.close()
    if not best:
        return learner.normalizer.mean_and_scale()
    weights, mean, scale = best
    learner.sac.average.flat.copy_(weights)
    return mean, scale


def percent(value: float, of: float) -> float:
    """nan of nothing."""
    return 100 * value / of if of else float("nan")


def rank(row: Mapping[str, float], kept: str = "reference") -> tuple[float, ...]:
    """Less is better: falls first, then whether it passed, then the error, the larger the further off its speed is;
    the task reward in their place where it decides, and of a baseline."""
    if kept == "task_reward" or "error_over_variance" not in row:
        return row["falls"], -row["task_reward"]
    error = row["error_over_variance"] * (1 + abs(row["speed_error_percent"]) / SPEED)
    return row["falls"], 1.0 - row["passed"], error if np.isfinite(error) else np.inf, -row["task_reward"]
