"""What commands of humanoids may be, and one line that names the argument where they are none."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from romgrl.config.teachers import TOP_SPEED, TOP_STIFFNESS_SHARE

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

SPEED, WEIGHTS, STYLE = 0, slice(1, -1), -1
"""Columns of a command."""
FASTEST_COMMAND, STIFFEST_STYLE = float(TOP_SPEED), float(TOP_STIFFNESS_SHARE)
"""The most that is asked for, m/s and share of a leg's stiffness."""
ROUNDING = 1e-6
"""Seconds, or control steps, by which a change may seem to be late and is not."""


def shown(value: Any) -> str:
    """A value on one short line."""
    return " ".join(reprlib.repr(value.tolist() if isinstance(value, np.ndarray) else value).split())


def numbers(name: str, values: ArrayLike) -> Array:
    """A copy as float64; ValueError unless they are numbers in an array of some shape."""
    try:
        found = np.array(values)
    except (TypeError, ValueError, RuntimeError):
        found = np.array(None)
    if found.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be a number or an array of numbers, not {shown(values)}")
    return found.astype(np.float64)


def numbers_of_each(name: str, values: ArrayLike, count: int | None = None) -> Array:
    """A number (), or one for each of N humanoids (N,); ValueError for another shape, or for another N than `count`."""
    found = numbers(name, values)
    if found.ndim > 1 or 0 in found.shape or (count is not None and found.size not in (1, count)):
        several = "one for each humanoid" if count is None else f"{count} of them"
        raise ValueError(f"{name} must be a number or {several}, not {shown(values)}")
    return found


def number_between(name: str, value: float, most: float | None = None) -> float:
    """The number; ValueError unless it is from 0 to `most`, None: finite."""
    found = numbers(name, value)
    if found.ndim or not (0 <= found <= (np.finfo(np.float64).max if most is None else most)):
        needed = "at least 0 and finite" if most is None else f"between 0 and {most:g}"
        raise ValueError(f"{name} must be {needed}, not {shown(value)}")
    return float(found)


def check_range(
    name: str, limits: tuple[float, float], *, top: float | None = None, positive: bool = False
) -> tuple[float, float]:
    """Its two ends; ValueError unless they rise from 0, or from above it, to `top` at the most, None: finite."""
    found = numbers(name, limits)
    if found.shape == (2,):
        low, high = found.tolist()
        least = np.float32(low) > 0 if positive else low >= 0  # commands are float32, in which 1e-50 is 0
        if least and low <= high <= (np.finfo(np.float64).max if top is None else top):
            return low, high
    needed = f"{'above' if positive else 'from'} 0" + ("" if top is None else f" to {top:g}")
    raise ValueError(f"{name} must be a finite range {needed}, such as (1.0, 2.0), not {shown(limits)}")


def check_gaits(gaits: Any) -> tuple[str, ...]:
    """Their names; ValueError unless they are a tuple or list, which have an order, of different ones."""
    named = isinstance(gaits, tuple | list) and all(isinstance(gait, str) and gait for gait in gaits)
    if not named or not gaits or len({*gaits}) < len(gaits) or {"speed", "style"} & {*gaits}:
        needed = "a tuple or list of one or more different names, none of them speed or style"
        raise ValueError(f"gaits must be {needed}, not {shown(gaits)}")
    return tuple(gaits)


def check_weights_by_name(gait: Any) -> Mapping[str, ArrayLike]:
    """The mapping; ValueError unless it is one."""
    if not isinstance(gait, Mapping):
        raise ValueError(f"gait must have a weight for each name, such as {{'walk': 1.0}}, not {shown(gait)}")
    return gait


def check_commands(commands: Array) -> None:
    """ValueError unless these (..., 2 + G) are commands as float32, which they are held as."""
    with np.errstate(over="ignore"):
        held = commands.astype(np.float32).astype(np.float64)
    speed, weights, style = held[..., SPEED], held[..., WEIGHTS], held[..., STYLE]
    for name, column, good, needed in (
        ("speed", SPEED, (speed >= 0) & (speed <= FASTEST_COMMAND), f"between 0 and {FASTEST_COMMAND:g} m/s"),
        ("style", STYLE, (style > 0) & (style <= STIFFEST_STYLE), f"above 0 and at most {STIFFEST_STYLE:g}"),
    ):
        if not good.all():
            raise ValueError(f"{name} must be {needed}, not {commands[..., column][~good][0]}")
    good = (weights >= 0).all(axis=-1) & (np.abs(weights.sum(axis=-1) - 1.0) <= ROUNDING)
    if not good.all():
        wrong = commands[..., WEIGHTS][~good][0]
        raise ValueError(f"weights of the gaits must be at least 0 and sum to 1, not {shown(wrong)}")
