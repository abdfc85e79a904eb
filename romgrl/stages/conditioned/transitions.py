"""A walker that is asked for something else: steps from one command to another, and a ramp over all speeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from romgrl.gait.command_following import overshoot, running_mean, settling_time, strides
from romgrl.gait.features import Bools, Floats, Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.gait_classes import classified
from romgrl.gait.human_bands import ON_TWO_FEET
from romgrl.gait.metrics import SETTLING_TIME, describe
from romgrl.stages.conditioned.asked_episodes import Arrays, Asked, TableRow, Walker, blocks, made_once
from romgrl.stages.conditioned.cells import CommandCells

BEFORE, AFTER = 5.0, 10.0
"""Seconds of a step before the command changes and after it."""
SLOW, FAST, BOTH_AT = 1.0, 4.0, 2.0
"""m/s: ends of the steps of speed, and where walk and run are exchanged."""
RAMP_SPEEDS, RAMP_SECONDS = (0.5, 5.0), 60.0
"""m/s, up and down in that time, after LEAD seconds at the slowest."""
LEAD = SETTLING_TIME
RAMP_EPISODES = 16
"""At most."""
BIN = 0.25
"""Of asked speeds along the ramp, m/s."""
STEP_PART, RAMP_PART = 1, 2
"""Of the evaluation, `Walker.block`."""


class Command(NamedTuple):
    """A gait at a speed, m/s; 0: to stand."""

    gait: str
    speed: float

    def __str__(self) -> str:
        return f"{self.gait} {self.speed:g}" if self.speed else "stand"


class Transition(NamedTuple):
    """From one command to another."""

    before: Command
    after: Command

    def __str__(self) -> str:
        return f"{self.before} -> {self.after}"


def asked_transitions(cells: CommandCells, *, standing: bool) -> list[Transition]:
    """The steps that the speeds of a library permit, each once; `standing`: it is asked for in the training."""
    slow, fast = (command_near(cells, speed) for speed in (SLOW, FAST))
    found = [Transition(slow, fast), Transition(fast, slow)]
    if {*ON_TWO_FEET} <= {*cells.gaits}:
        walk, run = (Command(gait, clipped(cells, gait, BOTH_AT)) for gait in ON_TWO_FEET)
        found += [Transition(walk, run), Transition(run, walk)]
    if standing:
        slowest = command_near(cells, 0.0)
        found.append(Transition(Command(slowest.gait, 0.0), slowest))
    return [*dict.fromkeys(each for each in found if each.before != each.after)]


def command_near(cells: CommandCells, speed: float) -> Command:
    """The speed that is nearest to one, in a gait that people would choose, where the library has such."""
    gaits = [gait for gait in ON_TWO_FEET if gait in cells.gaits] or list(cells.gaits)
    found = [Command(gait, clipped(cells, gait, speed)) for gait in gaits]
    middle = {gait: float(cells.ranges[cells.gaits.index(gait)].mean()) for gait in gaits}
    return min(found, key=lambda each: (abs(each.speed - speed), abs(middle[each.gait] - speed)))


def clipped(cells: CommandCells, gait: str, speed: float) -> float:
    """A speed within what is asked of a gait, m/s."""
    low, high = cells.ranges[cells.gaits.index(gait)]
    return float(np.clip(speed, low, high))


def weights_of(cells: CommandCells, gaits: Sequence[str]) -> tuple[float, ...]:
    """Equal weights of some gaits."""
    return tuple(float(gait in gaits) / len(gaits) for gait in cells.gaits)


def walk_transitions(
    cells: CommandCells, asked: Sequence[Transition], name: str, walker: Walker, episodes: int, directory: Path
) -> list[TableRow]:
    """Rows of transitions.csv of a walker."""
    steps = round((BEFORE + AFTER) / cells.dt)
    groups = [
        Asked((0.0, BEFORE), (each.before.speed, each.after.speed), tuple(weights_of(cells, [c.gait]) for c in each))
        for each in asked
    ]
    rows: list[TableRow] = []
    for number, block in enumerate(blocks(groups, episodes * steps)):
        ours = asked[len(rows) : len(rows) + len(block)]

        def make(block: Sequence[Asked] = block, ours: Any = ours, number: int = number) -> tuple[Any, Arrays]:
            walked = walker.block(block, episodes, steps, STEP_PART, number)
            return [transition_row(cells, each, name, one.gait) for each, one in zip(ours, walked, strict=True)], dict[
                str, Any
            ]()

        rows += made_once(directory / f"{name}_transitions_{number:03d}.npz", make)[0]
    return rows


def transition_row(cells: CommandCells, asked: Transition, name: str, gait: Gait) -> TableRow:
    """Of transitions.csv: medians over the episodes that do not fall, settling time over those that settle."""
    assert gait.velocity is not None
    change, before, after = round(BEFORE / gait.dt), asked.before, asked.after
    stride = steps_of_stride(cells, after)
    times, beyond = [], []
    for velocity in gait.velocity[~gait.fallen]:
        speed = running_mean(velocity, stride)[change:]
        times.append(settling_time(speed, after.speed, gait.dt))
        beyond.append(overshoot(speed, before.speed, after.speed))
    settled = [time for time in times if math.isfinite(time)]
    found = classified(from_step(gait, change))
    return {
        "walker": name,
        "transition": str(asked),
        "from_gait": before.gait,
        "from_m_per_s": before.speed,
        "to_gait": after.gait,
        "to_m_per_s": after.speed,
        "episodes": len(gait.fallen),
        "falls": int(gait.fallen.sum()),
        "settled": len(settled),
        "settling_time_s": float(np.median(settled)) if settled else math.nan,
        "overshoot_m_per_s": float(np.median(beyond)) if beyond else math.nan,
        "obeyed_gait": found.count(after.gait) / len(found),
    }


def from_step(gait: Gait, step: int) -> Gait:
    """The same from a step on, without loads."""
    arrays: dict[str, Any] = {
        name: value[:, step:] for name, value in vars(gait).items() if isinstance(value, np.ndarray) and value.ndim > 1
    }
    return replace(gait, loads=None, **arrays)


def steps_of_stride(cells: CommandCells, asked: Command) -> int:
    """Control steps of a stride of the reference that is nearest to a command, one second of one that has none."""
    number = cells.gaits.index(asked.gait)
    mine = np.flatnonzero(cells.gait == number)
    cell = int(mine[np.abs(cells.speed[mine] - asked.speed).argmin()])
    together = FOOTFALLS[asked.gait].together
    rate = describe(cells.teacher(cell), target_speed=asked.speed, hops=together)["stride_frequency_hz"]
    return max(1, round(1.0 / ((rate if rate > 0 else 1.0) * cells.dt)))


class Ramp(NamedTuple):
    """Up from the slowest to the fastest speed and down again, m/s, with equal weights of `gaits`."""

    gaits: tuple[str, ...]
    slowest: float
    fastest: float

    @property
    def auto(self) -> bool:
        """Walk and run are left to the walker to choose from."""
        return len(self.gaits) > 1

    def asked(self, cells: CommandCells) -> Asked:
        """Its commands."""
        weights, half = weights_of(cells, self.gaits), 0.5 * RAMP_SECONDS
        speeds = (self.slowest, self.slowest, self.fastest, self.slowest)
        return Asked((0.0, LEAD, LEAD + half, LEAD + RAMP_SECONDS), speeds, (weights,) * 4, ramp=True)


def asked_ramp(cells: CommandCells) -> Ramp:
    """Of walk and run where a library has both, or else of the gait with the widest range."""
    gaits = (
        ON_TWO_FEET if {*ON_TWO_FEET} <= {*cells.gaits} else (cells.gaits[int(np.ptp(cells.ranges, axis=1).argmax())],)
    )
    rows = cells.ranges[[cells.gaits.index(gait) for gait in gaits]]
    low, high = np.clip((rows.min(), rows.max()), *RAMP_SPEEDS)
    return Ramp(tuple(gaits), float(low), float(high))


def walk_ramp(
    cells: CommandCells, ramp: Ramp, name: str, walker: Walker, episodes: int, directory: Path
) -> tuple[list[TableRow], Arrays]:
    """Rows of ramp.csv of a walker, and what was recorded of one episode."""
    lead, steps = round(LEAD / cells.dt), round((LEAD + RAMP_SECONDS) / cells.dt)
    asked = ramp.asked(cells)

    def make() -> tuple[Any, Arrays]:
        (walked,) = walker.block([asked], min(episodes, RAMP_EPISODES), steps, RAMP_PART)
        commands = asked.at(cells.dt * np.arange(lead, steps))
        recorded = {key: values[lead:] for key, values in walked.longest().items()}
        return ramp_rows(name, from_step(walked.gait, lead), commands[:, 0]), recorded | {"command": commands}

    rows, arrays = made_once(directory / f"{name}_ramp.npz", make)
    return rows, arrays


def ramp_rows(name: str, gait: Gait, asked: Floats) -> list[TableRow]:
    """Of ramp.csv: each BIN of asked speeds (T,), m/s, on the way up and on the way down."""
    assert gait.velocity is not None
    assert gait.contact is not None
    middle, upright = len(asked) // 2, gait.valid
    bins = np.minimum(np.floor(asked / BIN + 1e-6), np.ceil(asked.max() / BIN - 1e-6) - 1).astype(int)
    found = [
        (start, stop, duty, 1.0 / ((stop - start) * gait.dt))
        for contact, valid in zip(gait.contact, upright, strict=True)
        for start, stop, duty in strides(contact[valid])
    ]
    centre = np.array([(start + stop) // 2 for start, stop, *_ in found], int)
    numbers = np.array([rest for _, _, *rest in found]).reshape(-1, 2)
    fell = np.where(gait.fallen, upright.sum(axis=1), -1)
    rows = []
    for direction, half in (("up", slice(0, middle)), ("down", slice(middle, len(asked)))):
        there = np.zeros(len(asked), bool)
        there[half] = True
        for number in dict.fromkeys(bins[half].tolist()):
            steps = there & (bins == number)
            rows.append(
                {
                    "walker": name,
                    "direction": direction,
                    "asked_m_per_s": float(asked[steps].mean()),
                    "episodes": int(upright[:, steps].all(axis=1).sum()),
                    "falls": int(steps[np.maximum(fell, 0)][fell >= 0].sum()),
                    **_bin_of(gait.velocity, upright & steps, asked, numbers[steps[centre]] if len(found) else numbers),
                }
            )
    return rows


def _bin_of(velocity: Floats, counted: Bools, asked: Floats, strides_there: Floats) -> TableRow:
    """Means over the steps (E, T) of a bin, and over its strides (S, 2): duty factor and rate, Hz."""
    off = (velocity - asked)[counted]
    duty, rate = strides_there.mean(axis=0) if len(strides_there) else (math.nan, math.nan)
    return {
        "speed_m_per_s": float(velocity[counted].mean()) if counted.any() else math.nan,
        "speed_error_m_per_s": float(off.mean()) if counted.any() else math.nan,
        "stride_frequency_hz": float(rate),
        "duty_factor": float(duty),
        "strides": len(strides_there),
    }
