"""How fast a teacher is in the long run while it learns, and how high it jumps: rolled out without exploration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from romgrl.config.schema import Config
from romgrl.config.teachers import LONG_RUN
from romgrl.gait.features import Gait
from romgrl.gait.recording import Policy, record
from romgrl.rom.interface import RomVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.wiring.commands import checked_tasks
from romgrl.stages.wiring.jumps_asked import jumps_asked
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.seeds import CHECK_SEED

WORLDS, STEPS, STEADY = 8, LONG_RUN, 200
"""A check is so many episodes of so many steps, of which the last ones give the speed: a teacher that was trained on
shorter episodes takes up to 25 s from a reset to it."""
FROM = 0.5
"""Share of the training from which policies are checked."""
SPEED = 3.0
"""A policy holds its speed within so many percent."""
APEX = 0.03
"""And the apex of its jumps within so many m."""
FILE = "checks.csv"


class Checked(Protocol):
    """A learner whose policies are checked, and which can go back to one of them."""

    def mean_policy(self) -> Policy:
        """Its policy without exploration."""
        ...

    def policy_vector(self) -> Any:
        """All numbers of that policy (P,)."""
        ...

    def put_policy_vector(self, vector: Any, /) -> None:
        """Make it that policy again."""
        ...


@dataclass
class SpeedChecks:
    """Checks of the mean policy every `interval` steps (0: none), over the second half of a training.

    The policy that is kept falls least, then is nearest to what is asked (within SPEED and APEX all are), then is the
    last. worlds: by the configuration that says what they are asked for; a teacher of a range counts by its worst.
    """

    interval: int
    config: Config
    worlds: list[tuple[Config, RomVectorEnv]]
    output: Path
    log: StageLog
    rows: list[dict[str, float]] = field(default_factory=list)
    best: Tensor | None = None
    """The best policy, as the `policy_vector` of the learner gives it."""
    due: int = 0

    @classmethod
    def of(
        cls, config: Config, output: Path, log: StageLog, *, interval: int, total: int, episodes: int | None = None
    ) -> SpeedChecks:
        """Those of a configuration, every `interval` of the `total` steps (or generations) of its training.

        episodes: of each check; WORLDS where nothing is said.
        """
        worlds = [
            (at, rom_env(at, num_envs=episodes or WORLDS, episode_steps=STEPS + 1))
            for at in (checked_tasks(config) if interval else ())
        ]
        return cls(interval, config, worlds, output, log, due=round(FROM * total))

    def check_if_due(self, step: int, learner: Checked) -> None:
        """Check the policy where `step` has come to the next multiple of the interval."""
        if not self.worlds or step < self.due:
            return
        self.due = step + self.interval
        seed, policy = self.config.seed + CHECK_SEED, learner.mean_policy()
        measured = []
        for at, env in self.worlds:
            gait = record(env, policy, steps=STEPS, seed=seed, dt=env.dt)
            row = {"asked_m_per_s": at.teacher.speed} | measure(gait, at.teacher.speed)
            gait.valid[:, :-STEADY] = False
            measured.append(row | jumps_asked(at, gait, env.parameters))
        row = {"step": float(step)} | worst(measured)
        self.rows.append(row)
        if min(self.rows, key=rank) is row:
            self.best = torch.as_tensor(learner.policy_vector())
        pd.DataFrame(self.rows).to_csv(self.output / FILE, index=False)

    def keep_best(self, learner: Checked) -> None:
        """Give the policy its best weights."""
        for _, env in self.worlds:
            env.close()
        if self.best is None:
            return
        learner.put_policy_vector(self.best)
        row = min(self.rows, key=rank)
        episodes = sum(env.num_envs for _, env in self.worlds)
        self.log.message(
            f"kept the policy of step {row['step']:,.0f}: falls in {row['falls']:.0f} of {episodes} episodes, "
            f"{row['steady_speed_m_per_s']:.2f} m/s in the long run"
            + (f", {row['jump_apex_m']:.3f} m high" if "jump_apex_m" in row else "")
            + (" where it is furthest from what was asked" if len(self.worlds) > 1 else "")
        )

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        names = list(self.rows[0]) if self.rows else []
        kept = {} if self.best is None else {"best": self.best}
        return {"due": self.due, "names": names, "rows": [list(row.values()) for row in self.rows]} | kept

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.due = int(state["due"])
        self.rows = [dict(zip(state["names"], map(float, row), strict=True)) for row in state["rows"]]
        self.best = torch.as_tensor(state["best"]) if self.rows else None


def measure(gait: Gait, speed: float) -> dict[str, float]:
    """A row of checks.csv: falls, and the speed of those that still run over the last STEADY steps (nan: none does)."""
    assert gait.velocity is not None
    steady = gait.velocity[~gait.fallen, -STEADY:]
    reached = float(steady.mean()) if steady.size else float("nan")
    error = 100 * (reached / speed - 1 if speed else reached)  # where nothing is to move, of 1 m/s
    return {"falls": float(gait.fallen.sum()), "steady_speed_m_per_s": reached, "speed_error_percent": error}


def worst(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Falls of all, and the speed that is furthest from what was asked: where none runs, that counts as furthest."""
    furthest = max(rows, key=off)
    return {**furthest, "falls": sum(row["falls"] for row in rows)}


def rank(row: Mapping[str, float]) -> tuple[float, float, float]:
    """Less is better."""
    return row["falls"], max(off(row), 1.0), -row["step"]


def off(row: Mapping[str, float]) -> float:
    """How many times as far as it may be a gait is from the speed asked for, or from the apex; infinite: none is."""
    errors = abs(row["speed_error_percent"]) / SPEED, row.get("jump_apex_error_m", 0.0) / APEX
    return float(np.nan_to_num(errors, nan=np.inf).max())
