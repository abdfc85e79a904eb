"""Orbital stability of a teacher: Floquet multipliers of its stride."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from romgrl.gait.floquet import Multipliers, decay, jacobians, multipliers
from romgrl.rom.return_map import FOOT, SIDES, StrideMap, Walkers

Array = NDArray[np.float64]
DISTURBANCE = 0.04  # of leg length, sqrt(g L0), largest torque and so on; as much as the clock alone moves a gait
SETTLING_STRIDES = 12
DECAY_STRIDES = 8
AT_END = 1e-6  # m
NO_GAIT = "no gait"


def teacher_multipliers(stride: StrideMap, worlds: int = 256, seed: int = 0) -> pd.DataFrame:
    """floquet.csv: one row per multiplier of the return map over one stride, then the largest, measured over several.

    modulus, real, imaginary: per stride; low and high: 95 % interval of the largest modulus over worlds; worlds: those
    that count; fell: those that fell or stood before or after a disturbance. verdict, the same in all rows: whether the
    interval over several strides lies below one (stable), above (unstable) or neither (undecided); "no gait" without
    two walkers that count.

    Each world is disturbed where it crosses the section, in one coordinate at a time to both sides, while its clock and
    the action that it holds stay as they are. Clocks differ from world to world; averaged over them is the response
    of the mean, in which the clock's own shift, which never decays, has no part.
    """
    start = stride.settled(worlds, strides=SETTLING_STRIDES, seed=seed)
    walking = np.isfinite(start.time)
    nothing = [_row(1, 1, complex("nan"), float("nan"), float("nan"), worlds, 0, NO_GAIT)]
    if walking.sum() < 2:
        return pd.DataFrame(nothing)
    free = free_coordinates(stride, start.contact[walking], start.coordinates[walking])
    disturb = _disturber(stride, start.walkers.rows(walking), start.coordinates[walking], free)
    points = (start.coordinates[walking] / stride.scales)[:, free]
    steps = np.full(points.shape[1], DISTURBANCE)
    matrices = _complete(jacobians(lambda rows: _walk(stride, disturb(rows), 1, free)[:, 0], points, steps))
    if len(matrices) < 2:
        return pd.DataFrame(nothing)
    one = multipliers(matrices, seed=seed)
    sides = [points + sign * DISTURBANCE * one.direction for sign in (1, -1)]
    up, down = np.split(_walk(stride, disturb(np.concatenate(sides)), DECAY_STRIDES, free), 2)
    lasting = _complete((up - down) / (2 * DISTURBANCE))
    if len(lasting) < 2:
        return pd.DataFrame(_rows(1, one, worlds, len(matrices), NO_GAIT))
    many = decay(lasting @ one.slowest.T, seed=seed)
    rows = _rows(1, one, worlds, len(matrices), many.verdict)
    return pd.DataFrame(rows + _rows(DECAY_STRIDES, many, worlds, len(lasting), many.verdict))


def verdict(table: pd.DataFrame) -> str:
    """One line of what floquet.csv says."""
    last = table[table["rank"] == 1].iloc[-1]
    if last.verdict == NO_GAIT:
        return f"teacher: no multipliers, {last.fell:.0f} of {last.fell + last.worlds:.0f} worlds fell or stood"
    interval = f"{last.low:.3f} to {last.high:.3f}"
    return f"teacher: largest multiplier {last.modulus:.3f}, {interval}, over {last.strides} strides: {last.verdict}"


def free_coordinates(stride: StrideMap, contact: NDArray[np.bool_], coordinates: Array) -> NDArray[np.bool_]:
    """Those that can be disturbed on the section (n,): all but y and velocities of a foot that ever stands there, and
    the extension and its rate of a leg whose motor is ever at an end of its stroke, which holds it there."""
    fixed = [f"{SIDES[i]}_foot_{name}" for i in range(len(SIDES)) if contact[:, i].any() for name in FOOT]
    for side in SIDES:
        extension = coordinates[:, [name == f"{side}_extension" for name in stride.names]]
        if any(np.isclose(extension, end, atol=AT_END).any() for end in stride.stroke):
            fixed += [f"{side}_extension", f"{side}_extension_rate"]
    return np.array([name not in fixed for name in stride.names])


def _disturber(
    stride: StrideMap, walkers: Walkers, coordinates: Array, free: NDArray[np.bool_]
) -> Callable[[Array], Walkers]:
    """Copies of the walkers (M) with the free coordinates that rows (c M, n) say, in their units."""

    def disturb(rows: Array) -> Walkers:
        copies = len(rows) // len(coordinates)
        offsets = np.zeros((len(rows), len(free)))
        offsets[:, free] = rows - np.tile((coordinates / stride.scales)[:, free], (copies, 1))
        return stride.disturbed(walkers.tiled(copies), offsets * stride.scales)

    return disturb


def _walk(stride: StrideMap, walkers: Walkers, strides: int, free: NDArray[np.bool_]) -> Array:
    """Free coordinates at each of the next crossings, in their units: (B, strides, n); nan from a fall on."""
    crossings = []
    fallen = np.zeros(len(walkers.states), bool)
    for _ in range(strides):
        crossing = stride.walk(walkers)
        walkers = crossing.walkers
        fallen |= np.isnan(crossing.time)
        crossings.append(np.where(fallen[:, None], np.nan, (crossing.coordinates / stride.scales)[:, free]))
    return np.stack(crossings, axis=1)


def _complete(arrays: Array) -> Array:
    """Those of (M, ., .) without nan."""
    return np.asarray(arrays[np.isfinite(arrays).all(axis=(1, 2))])


def _rows(strides: int, found: Multipliers, worlds: int, counted: int, verdict: str) -> list[dict[str, object]]:
    rows = []
    for rank, value in enumerate(found.values, start=1):
        low, high = (found.low, found.high) if rank == 1 else (float("nan"), float("nan"))
        rows.append(_row(strides, rank, complex(value), low, high, worlds, counted, verdict))
    return rows


def _row(
    strides: int, rank: int, value: complex, low: float, high: float, worlds: int, counted: int, verdict: str
) -> dict[str, object]:
    numbers = {"modulus": abs(value), "real": value.real, "imaginary": value.imag, "low": low, "high": high}
    return {
        "strides": strides,
        "rank": rank,
        **numbers,
        "worlds": counted,
        "fell": worlds - counted,
        "verdict": verdict,
    }
