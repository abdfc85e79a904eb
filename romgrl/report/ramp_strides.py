"""The ramp of a student that follows commands, stride by stride: speed asked and held, cadence and gait over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.command_following import RUNS_BELOW, running_mean
from romgrl.gait.features import Bools, Floats
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.metrics import touchdowns

LEAST_STRIDE = 0.3
"""s: what lands sooner has bounced."""
SPEED, FIRST_WEIGHT = 0, 1
"""Columns of a command."""
MEAN_SECONDS = 1.0
GAIT_COLORS = {"walk": "#e69f00", "run": "#56b4e9", "hop": "#cc79a7", "skip": "#7b5ea7"}


@dataclass(frozen=True)
class RampStrides:
    """T steps that were asked for, the first `upright` of which the student did not fall in.

    time, asked (T,): s, m/s; held (T,): mean over MEAN_SECONDS, m/s, nan once it has fallen; wanted: the gait that was
    asked for (T,). starts (K + 1,): s at which the K strides of the left foot begin, and the last ends; cadence (K,),
    strides/s; duty (K,); gaits (K,).
    """

    time: Floats
    asked: Floats
    held: Floats
    wanted: list[str]
    starts: Floats
    cadence: Floats
    duty: Floats
    gaits: list[str]
    upright: int

    def now(self, step: int) -> str:
        """What there is to say of a step, in words."""
        wanted = f"asked {self.asked[step]:.2f} m/s, {self.wanted[step]}"
        if step >= self.upright:
            return f"{wanted}; fallen"
        stride = int(np.searchsorted(self.starts, self.time[step], side="right")) - 1
        strides = f", {self.cadence[stride]:.2f} strides/s, {self.gaits[stride]}" if self.within(stride) else ""
        return f"{wanted}; held {self.held[step]:.2f} m/s{strides}"

    def within(self, stride: int) -> bool:
        """Whether there is a stride of a number."""
        return 0 <= stride < len(self.cadence)

    @property
    def fell(self) -> bool:
        """Whether it did not come to the end."""
        return self.upright < len(self.time)

    @property
    def spans(self) -> list[tuple[str, float, float]]:
        """Gait, start and end, s, of each run of strides of one gait."""
        found: list[tuple[str, float, float]] = []
        for gait, (start, stop) in zip(self.gaits, pairwise(self.starts.tolist()), strict=True):
            if found and found[-1][0] == gait:
                start = found.pop()[1]
            found.append((gait, start, stop))
        return found


def ramp_strides(arrays: Mapping[str, NDArray[Any]]) -> RampStrides:
    """Of the arrays of recordings.npz."""
    dt, valid = float(arrays["dt"]), arrays["ramp_valid"].astype(bool)
    command, names = arrays["ramp_command"], [str(gait) for gait in arrays["gaits"]]
    upright = len(valid) if valid.all() else int(np.argmin(valid))
    held = np.full(len(valid), np.nan)
    held[:upright] = running_mean(arrays["ramp_velocity"][:upright].astype(float), round(MEAN_SECONDS / dt))
    contact = arrays["ramp_contact"][:upright].astype(bool)
    steps = stride_steps(contact[:, 0], dt)
    pairs = list(pairwise(steps))
    right = np.array(touchdowns(contact[:, 1]) if len(contact) > 2 else [], int)
    weights = command[:, FIRST_WEIGHT : FIRST_WEIGHT + len(names)]
    return RampStrides(
        time=dt * np.arange(len(valid)),
        asked=command[:, SPEED].astype(float),
        held=held,
        wanted=[" or ".join(name for name, weight in zip(names, row, strict=True) if weight > 0) for row in weights],
        starts=dt * np.array(steps, float),
        cadence=np.array([1.0 / (dt * (stop - start)) for start, stop in pairs]),
        duty=np.array([contact[start:stop].mean() for start, stop in pairs]),
        gaits=[gait_of_stride(contact[start:stop], landed_within(right, start, stop)) for start, stop in pairs],
        upright=upright,
    )


def stride_steps(contact: Bools, dt: float) -> list[int]:
    """Steps at which strides of a foot begin; contact (T,)."""
    found: list[int] = []
    for step in touchdowns(contact) if len(contact) > 2 else []:
        if not found or (step - found[-1]) * dt >= LEAST_STRIDE:
            found.append(step)
    return found


def landed_within(landed: NDArray[np.int64], start: int, stop: int) -> NDArray[np.int64]:
    """Those steps `landed` that lie from start on and before stop, counted from start."""
    return landed[(landed >= start) & (landed < stop)] - start


def gait_of_stride(contact: Bools, landed: NDArray[np.int64]) -> str:
    """Which gait a stride of the left foot (T, 2) shows, where the right foot lands at steps `landed` of it."""
    phase = float(abs((landed[0] / len(contact) + 0.5) % 1.0 - 0.5)) if len(landed) else 0.5
    off = {name: abs(phase - FOOTFALLS[name].phase) for name in ("hop", "skip")}
    nearest = min(off, key=lambda name: off[name])
    if off[nearest] <= FOOTFALLS[nearest].off and off[nearest] < 0.5 - phase:
        return nearest
    return "run" if contact.mean() < RUNS_BELOW else "walk"
