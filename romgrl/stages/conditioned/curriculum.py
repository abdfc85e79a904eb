"""Which commands are open: each gait's speeds from the middle outwards, in bins, as those at the edge are solved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from romgrl.config.commanded import ConditionedStudent
from romgrl.humanoid.command_checks import SPEED, WEIGHTS, Array, Rows
from romgrl.humanoid.command_schedules import DrawnCommands
from romgrl.humanoid.task import sensitivity, speed_reward
from romgrl.stages.conditioned.cells import CommandCells

BIN = 0.25
"""Width of a bin, m/s; the nearest one of which a whole number fits into a gait's range."""
FIRST_BINS = 3
"""In the middle of a range, with which a training begins."""
SOLVED = 0.8
"""Share of what the reference itself is paid for its speed, from which on a bin is solved."""
FEWEST_STEPS = 200
"""That a bin is judged by, since the last time that it was."""
SETTLED = 1.0
"""Seconds after a new command from which on its speed counts."""
OPEN_AT = 0.5
"""Share of a training after which all is open: a bin that stays behind its neighbours would close off all beyond it."""


class OpenCommands:
    """Commands drawn from what is open (a `romgrl.humanoid.command_schedules.CommandSchedule`)."""

    def __init__(self, student: ConditionedStudent, gaits: tuple[str, ...], ranges: Array) -> None:
        self.gaits, self.count, self._student = gaits, None, student
        self.open(ranges)

    def open(self, ranges: Array) -> None:
        """Draw speeds from these ranges (G, 2), m/s, from now on."""
        low, high = self._student.hold_seconds
        self._drawn = DrawnCommands(
            self.gaits,
            {gait: (float(ends[0]), float(ends[1])) for gait, ends in zip(self.gaits, ranges, strict=True)},
            hold_seconds=(low, high),
            step_share=self._student.step_share,
            standing_share=self._student.standing_share,
        )

    def following(
        self, generator: np.random.Generator, rows: Rows, seconds: Array, before: Array | None
    ) -> tuple[Array, Array]:
        """Drawn anew, with the time for which each is held."""
        return self._drawn.following(generator, rows, seconds, before)


class Curriculum:
    """The bins of each gait, what was earned in them, and which are open.

    A neighbour of the open bins opens when the one at their edge is solved, its share of the reference's own speed
    reward at least SOLVED, and its imitation reward is at least the median of the solved bins of its gait.
    `opened` (G, 2): first and last open bin of each gait. `limits` (G, 2), m/s: tells the replay buffer what is open.
    """

    def __init__(self, student: ConditionedStudent, cells: CommandCells, alpha: float | None, num_envs: int) -> None:
        self.alpha, self.gaits, self.full = alpha, cells.gaits, cells.ranges
        self.counts = np.maximum(1, np.round(np.diff(self.full)[:, 0] / BIN).astype(int))
        shape = (len(self.gaits), int(self.counts.max()))
        middle = (self.counts - 1) // 2
        reach = FIRST_BINS // 2 if student.curriculum else int(self.counts.max())
        self.opened = np.stack((np.maximum(0, middle - reach), np.minimum(self.counts - 1, middle + reach)), axis=1)
        self.paid, self.steps = np.zeros(shape), np.zeros(shape)
        self.most = np.ones(shape)
        for gait, number in np.ndindex(shape):
            self.most[gait, number] = reference_payment(cells, gait, self.centre(gait, number), alpha)
        self.schedule = OpenCommands(student, cells.gaits, self.ranges)
        self.asked = np.zeros((num_envs, len(self.gaits) + 2), np.float32)
        self.since = np.zeros(num_envs, np.int64)
        self._settled = round(SETTLED / cells.dt)

    @property
    def widths(self) -> Array:
        """Of the bins of each gait (G,), m/s."""
        widths: Array = np.diff(self.full)[:, 0] / self.counts
        return widths

    @property
    def ranges(self) -> Array:
        """What is open of each gait (G, 2), m/s."""
        ends = self.full[:, :1] + (self.opened + np.array([0, 1])) * self.widths[:, None]
        open_now: Array = np.clip(ends, self.full[:, :1], self.full[:, 1:])
        return open_now

    def centre(self, gait: int, number: int) -> float:
        """Speed in the middle of a bin, m/s."""
        return float(self.full[gait, 0] + (number + 0.5) * self.widths[gait])

    def bins(self, gait: NDArray[np.int64], speed: Array) -> NDArray[np.int64]:
        """Numbers (N,) of the bins of gaits and speeds (N,)."""
        place = (speed - self.full[gait, 0]) / np.maximum(self.widths[gait], 1e-9)
        found: NDArray[np.int64] = np.clip(place.astype(np.int64), 0, self.counts[gait] - 1)
        return found

    def take(self, info: Mapping[str, Any]) -> None:
        """Take in one step of all environments."""
        commands = info["command"]
        changed = (commands != self.asked).any(axis=1)
        self.asked[:], self.since[:] = commands, np.where(changed, 0, self.since + 1)
        gait, speed = commands[:, WEIGHTS].argmax(axis=1), commands[:, SPEED].astype(float)
        counted = (self.since >= self._settled) & (speed > 0)
        gait, speed, velocity = gait[counted], speed[counted], info["forward_velocity"][counted]
        place = gait, self.bins(gait, speed)
        np.add.at(self.paid, place, speed_reward(velocity, speed=speed, alpha=sensitivity(self.alpha, speed)))
        np.add.at(self.steps, place, 1.0)

    def review(self, imitation: Array, share: float, limits: Tensor) -> bool:
        """Open what is due; whether anything was. Then what was earned is forgotten in the bins that were judged.

        imitation: reward in each bin (G, bins), nan where it is not known; all nan: there is no discriminator.
        share: of the training that is over; limits (G, 2): gets what is open.
        """
        judged = self.steps >= FEWEST_STEPS
        solved = judged & (self.paid >= SOLVED * self.most * self.steps)
        before = self.opened.copy()
        for gait, (first, last) in enumerate(before):
            known = imitation[gait, solved[gait]]
            median = np.nanmedian(known) if np.isfinite(known).any() else -np.inf
            good = solved[gait] & ~(imitation[gait] < median)
            self.opened[gait] = max(0, first - good[first]), min(self.counts[gait] - 1, last + good[last])
        if share >= OPEN_AT:
            self.opened[:, 0], self.opened[:, 1] = 0, self.counts - 1
        self.paid[judged] = self.steps[judged] = 0.0
        self.tell(limits)
        return bool((self.opened != before).any())

    def tell(self, limits: Tensor) -> None:
        """Let commands be drawn from what is open, now and when transitions are relabelled."""
        self.schedule.open(self.ranges)
        limits.copy_(limits.new_tensor(self.ranges.tolist()))

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        names = ("opened", "paid", "steps", "asked", "since")
        return {name: getattr(self, name) for name in names}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        for name, own in self.state().items():
            own[...] = state[name]
        self.schedule.open(self.ranges)


def reference_payment(cells: CommandCells, gait: int, speed: float, alpha: float | None) -> float:
    """What the reference of the taught cell nearest to a speed is paid for its own: it swings within a stride."""
    taught = [cell for cell in cells.taught_cells if cells.gait[cell] == gait]
    cell = min(taught, key=lambda each: abs(cells.speed[each] - speed))
    asked = float(cells.speed[cell])
    velocity = cells.references[cell]["velocity"].astype(float)
    return float(speed_reward(velocity, speed=asked, alpha=sensitivity(alpha, asked)).mean())
