"""What a student does of its commands while it learns: the curriculum, and the discriminator band by band."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from torch import Tensor

from romgrl.algorithms.commanded_windows import CellWindows
from romgrl.algorithms.conditioned_discriminator import ConditionedDiscriminator
from romgrl.algorithms.conditioned_rom_grl import ConditionedRomGrl
from romgrl.algorithms.discriminator_health import LASTING_ROWS, WATCHED, diagnose
from romgrl.config.commanded import conditioned_keys
from romgrl.config.schema import Config
from romgrl.humanoid.command_checks import Array
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.cells import CommandCells
from romgrl.stages.conditioned.curriculum import Curriculum
from romgrl.stages.training.budget import over_the_middle
from romgrl.stages.training.discriminator_watch import TOO_SHORT, health_setting

BANDS_FILE = "health_by_band.json"
SPEED_BAND = 1.0
"""Width of a band of speeds, m/s."""
NEWEST = 8192
"""Steps that a review looks back on."""
FEWEST_WINDOWS = 64
"""Of a band: with less, nothing is said of it."""


class SpeedBand(NamedTuple):
    """Speeds of a gait from `low` to `high`, m/s; the last one of a gait has its end, which many commands are."""

    gait: int
    low: float
    last: bool

    @property
    def high(self) -> float:
        """m/s."""
        return self.low + SPEED_BAND

    def has(self, gait: Tensor, speed: Tensor) -> Tensor:
        """Which gaits and speeds (N,) that are asked for lie in it."""
        return (gait == self.gait) & (speed >= self.low) & ((speed < self.high) | self.last)

    def among(self, cells: CellWindows) -> Tensor:
        """Which cells (C,) its commands lie between: those at both of its ends, too."""
        return (cells.gait == self.gait) & (cells.speed >= self.low) & (cells.speed <= self.high)

    def task_weight(self, learner: ConditionedRomGrl) -> float:
        """Mean weight of the task at its cells; at all of them where it has none."""
        among = None if learner.cells is None else self.among(learner.cells)
        return learner.eta if among is None or not bool(among.any()) else float(learner.etas[among].mean())


def speed_bands(ranges: Array) -> list[SpeedBand]:
    """Of the range (2,) of each gait (G, 2), m/s."""
    found = []
    for gait, (slowest, fastest) in enumerate(ranges.tolist()):
        first = np.floor(slowest)
        lows = np.arange(first, max(fastest, first + SPEED_BAND), SPEED_BAND).tolist()
        found += [SpeedBand(gait, low, low == lows[-1]) for low in lows]
    return found


class CommandWatch:
    """Reviews at each row of the learning curve what was earned under which command.

    It opens what the curriculum says, and writes BANDS_FILE: of each gait and band of speeds what is wrong with the
    discriminator, as health.json has it of all together.
    """

    def __init__(
        self,
        config: Config,
        cells: CommandCells,
        curriculum: Curriculum,
        learner: ConditionedRomGrl,
        output: Path,
        log: StageLog,
    ) -> None:
        self.curriculum, self._learner, self._log = curriculum, learner, log
        self._config, self._path, self._cells = config, output / BANDS_FILE, cells
        self.bands = speed_bands(cells.ranges)
        self._rows: list[list[dict[str, float]]] = [[] for _ in self.bands]

    def take(self, info: Mapping[str, Any]) -> None:
        """Take in one step of all environments."""
        self.curriculum.take(info)

    def review(self, step: int, share: float) -> dict[str, float]:
        """Open what is due after `step`, at a share of the training, and measure each band; numbers to log.

        The weight of the task is that of this share of the training from then on, where it moves.
        """
        learner = self._learner
        if (final := conditioned_keys(self._config.student).final_eta) is not None:
            learner.weigh_task(over_the_middle(self._config.eta, final, share))
        windows = learner.buffer.newest_windows(NEWEST)
        rewards = learner.imitation(windows)
        if self.curriculum.review(self.by_bin(windows, rewards), share, learner.relabelling.ranges):
            self._log.message(f"commands at step {step:,}: {self.opened()}")
        measured = {} if learner.discriminator is None else self.by_band(windows, rewards, step)
        open_speeds = float(np.diff(self.curriculum.ranges)[:, 0].sum())
        return {"open_m_per_s": open_speeds, **measured}

    def opened(self) -> str:
        """What is open, in words."""
        pairs = zip(self._cells.gaits, self.curriculum.ranges, strict=True)
        return ", ".join(f"{gait} from {low:.2f} to {high:.2f} m/s" for gait, (low, high) in pairs)

    def by_bin(self, windows: Tensor, rewards: Tensor) -> Array:
        """Mean imitation reward in each bin of the curriculum (G, bins), nan where there is no window of it."""
        curriculum, columns = self.curriculum, self._learner.relabelling.columns
        sums, counts = np.zeros(curriculum.paid.shape), np.zeros(curriculum.paid.shape)
        if self._learner.discriminator is not None:
            gait, speed = columns.gait(windows).cpu().numpy(), columns.speed(windows).cpu().numpy().astype(float)
            moving = speed > 0
            place = gait[moving], curriculum.bins(gait[moving], speed[moving])
            np.add.at(sums, place, rewards.cpu().numpy()[moving])
            np.add.at(counts, place, 1.0)
        return np.where(counts > 0, sums / np.maximum(counts, 1.0), np.nan)

    def by_band(self, windows: Tensor, rewards: Tensor, step: int) -> dict[str, float]:
        """What each band shows, by names that end with it; notes what is wrong there."""
        discriminator, learner = self._learner.discriminator, self._learner
        assert isinstance(discriminator, ConditionedDiscriminator)
        if discriminator.updates == 0:
            return {}
        columns, cells, found = discriminator.columns, discriminator.cells, dict[str, float]()
        gait, speed = columns.gait(windows), columns.speed(windows)
        pay = learner.relabelling.paid(windows[:, -1], speed)
        for number, band in enumerate(self.bands):
            inside, among = band.has(gait, speed) & cells.taught(windows), band.among(cells)
            if int(inside.sum()) < FEWEST_WINDOWS or not bool(among.any()):
                continue
            values = discriminator.measures_of(windows[inside], among)
            if not values:
                continue
            task, imitation = float(pay[inside].mean()), float(rewards[inside].mean())
            eta = band.task_weight(learner)
            total = eta * task + (1 - eta) * imitation
            values |= discriminator.accuracies_of(windows[inside], among)
            values |= {
                "imitation_reward": imitation,
                "imitation_share": (1 - eta) * imitation / max(total, 1e-6),
                "speed": float(windows[inside][:, -1].mean()),
            }
            self._rows[number].append({"step": float(step)} | {name: values[name] for name in WATCHED})
            del self._rows[number][:-LASTING_ROWS]
            name = f"{self._cells.gaits[band.gait]}_{band.low:g}_{band.high:g}"
            told = ("imitation_reward", "discriminator_feature_gap", "speed")
            found |= {f"{each}/{name}": values[each] for each in told} | {f"speed_reward/{name}": task}
        self.write()
        return found

    def write(self) -> None:
        """BANDS_FILE: verdict and evidence of each band, over the last rows."""
        document = {}
        for band, rows in zip(self.bands, self._rows, strict=True):
            middle, eta = band.low + 0.5 * SPEED_BAND, band.task_weight(self._learner)
            setting = replace(health_setting(self._config), speed=middle, eta=eta)
            now = diagnose(rows, setting)
            verdict = ", ".join(each.name for each in now) or ("healthy" if len(rows) >= LASTING_ROWS else TOO_SHORT)
            name = f"{self._cells.gaits[band.gait]} from {band.low:g} to {band.high:g} m/s"
            document[name] = {"verdict": verdict, "now": [each._asdict() for each in now]}
        self._path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        rows = {f"band_{n}": [number for row in each for number in row.values()] for n, each in enumerate(self._rows)}
        return {"curriculum": self.curriculum.state(), "bands": rows}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.curriculum.restore(state["curriculum"])
        names = ("step", *WATCHED)
        for number in range(len(self._rows)):
            flat = np.reshape(state["bands"][f"band_{number}"], (-1, len(names))).tolist()
            self._rows[number] = [dict(zip(names, row, strict=True)) for row in flat]
