"""What a row is, and how two sides are timed beside each other."""

from __future__ import annotations

import operator
import os
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

OPERATORS = {">=": operator.ge, "<=": operator.le}


class Unavailable(Exception):
    """A row that this machine cannot measure; the message says what is missing."""


@dataclass(frozen=True)
class Options:
    """How to measure: threads for both sides, and quick for a look that is no measurement."""

    threads: int = os.cpu_count() or 1
    quick: bool = False

    @property
    def repeats(self) -> int:
        """Alternations of the sides."""
        return 2 if self.quick else 7

    def scaled(self, count: int) -> int:
        """`count` units of work, a tenth of it for a quick look."""
        return max(1, count // 10) if self.quick else count


@dataclass(frozen=True)
class Result:
    """One measured row. `ratio` is what `target`, such as ">= 2", speaks of; without one it is `value`."""

    value: float | None
    unit: str
    reference: float | None = None
    ratio: float | None = None
    target: str | None = None
    settings: dict[str, Any] = field(default_factory=dict)

    def rounded(self) -> Result:
        """Four significant digits, more than any of these numbers has."""

        def cut(number: float | None) -> float | None:
            return None if number is None else float(f"{number:.4g}")

        return replace(self, value=cut(self.value), reference=cut(self.reference), ratio=cut(self.ratio))

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None without one."""
        number = self.value if self.ratio is None else self.ratio
        return None if self.target is None or number is None else reached(number, self.target)


def reached(number: float, target: str) -> bool:
    """Compare with a target such as ">= 2"."""
    symbol, limit = target.split()
    return bool(OPERATORS[symbol](number, float(limit)))


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def rate(work: Callable[[], object], count: float) -> Callable[[], float]:
    """A side for `interleave`: `count` units of work per second."""
    return lambda: count / seconds(work)


def interleave(sides: Mapping[str, Callable[[], float]], repeats: int) -> dict[str, list[float]]:
    """Measure the sides in turn, `repeats` times after one warm-up, so that other load hits all."""
    for side in sides.values():
        side()
    rounds = [{name: side() for name, side in sides.items()} for _ in range(repeats)]
    return {name: [each[name] for each in rounds] for name in sides}


def compare(
    ours: Callable[[], float],
    reference: Callable[[], float],
    *,
    unit: str,
    target: str | None,
    settings: Mapping[str, Any],
    repeats: int,
) -> Result:
    """A row of two sides in alternation: medians, their ratio, and the range of the ratio over the rounds."""
    samples = interleave({"ours": ours, "reference": reference}, repeats)
    value, other = (statistics.median(samples[name]) for name in ("ours", "reference"))
    ratios = [a / b for a, b in zip(samples["ours"], samples["reference"], strict=True)]
    spread = {"repeats": repeats, "ratio_range": [round(min(ratios), 3), round(max(ratios), 3)]}
    return Result(value, unit, other, value / other, target, {**settings, **spread}).rounded()
