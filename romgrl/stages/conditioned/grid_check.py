"""What a student that follows commands does at each cell of its library while it learns; the best policy is kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from torch import Tensor

from romgrl.algorithms.conditioned_rom_grl import ConditionedRomGrl
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.algorithms.sac import Mirrors
from romgrl.config.schema import Config
from romgrl.gait.alignment import error_over_variance
from romgrl.gait.command_following import speed_tolerance
from romgrl.gait.features import Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.gait_classes import episode
from romgrl.gait.metrics import describe
from romgrl.gait.recording import record
from romgrl.humanoid.command_schedules import CommandTable
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.provenance.kept_check import kept_check, worst_fifth
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.cells import CommandCells
from romgrl.stages.training.adapted_eta import ADAPTS_FROM, adapted
from romgrl.stages.training.budget import Budget
from romgrl.stages.training.gait_check import FILE, LONGEST_WINDOW, averaged_policy, give_best, percent
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.seeds import CHECK_SEED

EPISODES, STEPS = 4, 300
"""Of each cell."""
LOST = 10.0
"""What a cell is short of at most for its speed and for its gait, and for falling."""


@dataclass
class GridChecks:
    """Checks of the averaged policy at all cells every `interval` steps (0: none); the best one is kept.

    A policy is judged by the mean shortfall of the worst fifth of the cells. With `student.adapt_eta` what is found at
    a cell changes the weight of its task.
    """

    interval: int
    config: Config
    env: PlanarHumanoidVectorEnv | None
    cells: CommandCells
    imitates: bool
    columns: Tensor
    mirrors: Mirrors | None
    output: Path
    log: StageLog
    rows: list[dict[str, Any]] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    best: list[Tensor] = field(default_factory=list)
    """Weights of the best policy, mean and scale of its observations; empty before the first check."""

    @classmethod
    def of(
        cls,
        config: Config,
        cells: CommandCells,
        columns: Tensor,
        mirrors: Mirrors | None,
        output: Path,
        log: StageLog,
    ) -> GridChecks:
        """Those of a configuration: each cell EPISODES times in one environment."""
        interval = config.student.check_steps
        imitates = config.discriminator.enabled and config.eta < 1 and config.student.kept_policy != "task_reward"
        env = None
        if interval:
            grid = grid_commands(cells)
            count = EPISODES * len(cells.speed)
            env = humanoid_env(config, num_envs=count, episode_steps=STEPS + 1, commands=grid)
        return cls(interval, config, env, cells, imitates, columns, mirrors, output, log)

    def check_if_due(self, step: int, learner: RomGrl, budget: Budget) -> None:
        """Check the policy where `step` has reached a multiple of the interval without a check, and at the end."""
        if self.env is None or (step // self.interval <= len(self.scores) and not budget.reached(step)):
            return
        policy, weights = averaged_policy(learner, self.columns, self.mirrors)
        seed = self.config.seed + CHECK_SEED
        gait = record(self.env, policy, steps=STEPS, seed=seed, dt=self.env.control_step)
        rows = [self.measure(cell, episodes_of(gait, cell)) for cell in range(len(self.cells.speed))]
        self.rows += [{"step": float(step)} | row for row in rows]
        if self.config.student.adapt_eta and self.imitates and budget.reached(step, ADAPTS_FROM):
            self.adapt(rows, learner)
        self.scores.append(worst_fifth([row["shortfall"] for row in rows]))
        if self.kept == len(self.scores) - 1:
            self.best = weights
        pd.DataFrame([self.named(row) for row in self.rows]).to_csv(self.output / FILE, index=False)
        told = grid_summary(rows)
        self.log.message(f"grid at step {step:,}: {told}; worst fifth {self.scores[-1]:.2f}")

    def measure(self, cell: int, gait: Gait) -> dict[str, float]:
        """A row of checks.csv, of the episodes of a cell."""
        speed, teacher = float(self.cells.speed[cell]), self.cells.teacher(cell)
        hops = FOOTFALLS[self.cells.gaits[self.cells.gait[cell]]].together
        found, taught = (describe(each, target_speed=speed, hops=hops) for each in (gait, teacher))
        held = found["steady_speed_m_per_s"]
        row = {
            "cell": float(cell),
            "taught": float(self.cells.taught[cell]),
            "falls": found["falls"],
            "steady_speed_m_per_s": held,
            "speed_error_m_per_s": held - speed,
            "cadence_error_percent": percent(found["stride_frequency_hz"], taught["stride_frequency_hz"]) - 100,
        }
        window = min(LONGEST_WINDOW, int(teacher.valid.sum(axis=1).min()))
        error = float(error_over_variance(gait, teacher, window).mean())
        row["error_over_variance"] = error
        row["shortfall"] = shortfall(row, speed, imitates=self.imitates)
        return {name: float(value) for name, value in row.items()}

    def adapt(self, rows: Sequence[Mapping[str, float]], learner: RomGrl) -> None:
        """Change the weight of the task at each taught cell, as at one speed, but never to less than it began with.

        With what it does not fall below at one speed late, a half, speeds were right and strides were not.
        """
        assert isinstance(learner, ConditionedRomGrl)
        etas = learner.etas.tolist()
        for place, cell in enumerate(self.cells.taught_cells):
            row = rows[cell]
            off = percent(row["steady_speed_m_per_s"], float(self.cells.speed[cell])) - 100
            judged = {"speed_error_percent": off, "cadence_error_percent": row["cadence_error_percent"]}
            etas[place] = max(self.config.eta, adapted(etas[place], judged, fell=row["falls"] > EPISODES / 4))
        learner.etas.copy_(learner.etas.new_tensor(etas))
        learner.eta = float(learner.etas.mean())
        self.log.message(f"weight of the speed from {min(etas):.2f} to {max(etas):.2f}")

    def named(self, row: Mapping[str, float]) -> dict[str, Any]:
        """A row as checks.csv has it: with the gait and the speed of its cell in the place of its number."""
        cell = int(row["cell"])
        asked = {"gait": self.cells.gaits[self.cells.gait[cell]], "speed_m_per_s": float(self.cells.speed[cell])}
        return {"step": row["step"]} | asked | {name: row[name] for name in row if name not in ("step", "cell")}

    @property
    def kept(self) -> int:
        """Number of the check whose policy is kept."""
        return kept_check(self.scores, self.config.student.kept_policy)

    def keep_best(self, learner: RomGrl) -> tuple[Tensor, Tensor]:
        """Give the averaged policy of the agent the best weights; mean and scale of its observations."""
        if self.best:
            size = len(self.cells.speed)
            rows = self.rows[self.kept * size : (self.kept + 1) * size]
            self.log.message(f"kept the policy of step {rows[0]['step']:,.0f}: {grid_summary(rows)}")
        return give_best(self.best, self.env, learner)

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        rows = {"rows": [[*row.values()] for row in self.rows], "names": [*self.rows[0]] if self.rows else []}
        best = dict(zip(("weights", "mean", "scale"), self.best, strict=True)) if self.best else {}
        return rows | {"scores": [*self.scores]} | best

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.rows = [dict(zip(state["names"], map(float, row), strict=True)) for row in state["rows"]]
        self.scores = [float(score) for score in state["scores"]]
        self.best = [state[name] for name in ("weights", "mean", "scale")] if self.scores else []


def grid_commands(cells: CommandCells) -> CommandTable:
    """The command of each cell, held from the beginning to the end, EPISODES times in a row."""
    weights = {
        gait: np.repeat((cells.gait == number).astype(float), EPISODES) for number, gait in enumerate(cells.gaits)
    }
    return CommandTable.constant(np.repeat(cells.speed, EPISODES), weights)


def episodes_of(gait: Gait, cell: int) -> Gait:
    """The episodes of a cell."""
    return episode(gait, slice(cell * EPISODES, (cell + 1) * EPISODES))


def shortfall(row: Mapping[str, float], speed: float, *, imitates: bool) -> float:
    """How far a policy is from its cell: 0 at the right speed in the reference's paths, and LOST for each it has none
    of; falls count LOST times their share."""
    parts = [abs(row["speed_error_m_per_s"]) / speed_tolerance(speed), row["error_over_variance"] if imitates else 0.0]
    short: NDArray[np.float64] = np.minimum(np.nan_to_num(parts, nan=LOST), LOST)
    return float(LOST * row["falls"] / EPISODES + short.sum())


def right_speed(row: Mapping[str, float]) -> bool:
    """Tell whether a walker of a row falls nowhere and holds its speed."""
    speed = row["steady_speed_m_per_s"] - row["speed_error_m_per_s"]
    return not row["falls"] and abs(row["speed_error_m_per_s"]) <= speed_tolerance(speed)


def grid_summary(rows: list[dict[str, Any]]) -> str:
    """Of the rows of one check, in words."""
    right = sum(map(right_speed, rows))
    falls = sum(row["falls"] for row in rows)
    errors = [row["error_over_variance"] for row in rows if np.isfinite(row["error_over_variance"])]
    near = f", error over variance {np.median(errors):.2f} in the middle" if errors else ""
    held = f"speed held without a fall in {right} of {len(rows)} cells"  # the evaluation counts cells with falls, too
    return f"{held}, {falls:.0f} of {EPISODES * len(rows)} episodes fall{near}"
