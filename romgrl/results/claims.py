"""Claims as data, and the verdict on each: the rule stands here once, and in words in docs/method.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from romgrl.results.evaluation_index import FinishedEvaluation
from romgrl.results.statistics import (
    Interval,
    improvement_interval,
    probability_of_improvement,
    summarize,
)

CLAIMS = Path(__file__).with_name("claims.yaml")
FEWEST_SEEDS = 3  # below, nothing is said
ENOUGH_SEEDS = 5  # from here on, an interval that leaves it open counts against the claim
EVEN = 0.5  # probability of improvement where nothing is better
TOO_FEW, TOO_SHORT = "too few seeds", "evaluated too briefly"
YES = {"paper": "reproduced", "project": "reached"}
NO = {"paper": "not reproduced", "project": "not reached"}
INTERVALS: dict[str, Callable[[float, float], tuple[float, float]]] = {
    "at_least": lambda value, tolerance: (value, math.inf),
    "above": lambda value, tolerance: (math.nextafter(value, math.inf), math.inf),
    "at_most": lambda value, tolerance: (-math.inf, value),
    "about": lambda value, tolerance: (value - tolerance, value + tolerance),
    "better": lambda value, tolerance: (math.nextafter(EVEN, 1.0), 1.0),
}
SIGNS = {"at_least": "≥ ", "above": "> ", "at_most": "≤ ", "about": ""}


@dataclass(frozen=True)
class Claim:
    """One claim; claims.yaml explains the fields."""

    id: str
    of: str
    speed: float
    measure: str
    unit: str
    relation: str
    judged_by: str
    source: str
    value: float = math.nan
    tolerance: float = 0.0
    than: str | None = None
    way: str | None = None
    needs: Mapping[str, float] = field(default_factory=dict)
    where: Mapping[str, Any] = field(default_factory=dict)

    @property
    def limits(self) -> Interval:
        """The values for which the claim holds, ends included."""
        return Interval(*INTERVALS[self.relation](self.value, self.tolerance))

    @property
    def expected(self) -> str:
        """What is claimed, with its unit."""
        if self.than is not None:
            return f"{self.way} than the {self.than.partition('/')[0]}'s"
        spread = f" ± {self.tolerance:g}" if self.relation == "about" else ""
        return f"{SIGNS[self.relation]}{self.value:g}{spread} {self.unit}".strip()


@dataclass(frozen=True)
class Finding:
    """What the seeds say about a claim: an estimate with its interval; a probability of improvement for `better`."""

    claim: Claim
    estimate: float
    interval: Interval
    values: tuple[float, ...]
    verdict: str


def read_claims(path: Path = CLAIMS) -> list[Claim]:
    """All claims."""
    return [Claim(**entry) for entry in yaml.safe_load(path.read_text(encoding="utf-8"))["claims"]]


def claims_for(settings: Mapping[str, Any], claims: Sequence[Claim]) -> list[Claim]:
    """The claims that are made about a configuration, by its speed and other settings."""
    return [
        claim
        for claim in claims
        if claim.speed == settings["speed"] and all(settings.get(key) == value for key, value in claim.where.items())
    ]


def finding_of(claim: Claim, evaluations: Sequence[FinishedEvaluation]) -> Finding:
    """Compare a claim with evaluations of different seeds."""
    values = column(evaluations, claim.measure)
    if claim.than is None:
        summary = summarize(values)
        estimate, ends = summary.mean, summary.mean_interval
    else:
        assert claim.way in ("larger", "smaller")
        sign = 1.0 if claim.way == "larger" else -1.0
        ours, theirs = (sign * known(column(evaluations, name)) for name in (claim.measure, claim.than))
        estimate, ends = probability_of_improvement(ours, theirs), improvement_interval(ours, theirs)
        values = [value + 0 * other for value, other in zip(values, column(evaluations, claim.than), strict=True)]
    brief = any(each.settings.get(key, 0) < least for each in evaluations for key, least in claim.needs.items())
    return Finding(claim, estimate, ends, tuple(values), decide(claim, estimate, ends, values, brief=brief))


def decide(claim: Claim, estimate: float, ends: Interval, values: Sequence[float], *, brief: bool = False) -> str:
    """The verdict. nan among the values is a seed without the number, which counts against the claim."""
    limits = claim.limits

    def holds(value: float) -> bool:
        return limits.low <= value <= limits.high

    if claim.judged_by == "every_seed" and any(not holds(value) for value in values):
        return NO[claim.of]
    if len(values) < FEWEST_SEEDS:
        return TOO_FEW
    if any(math.isnan(value) for value in values):
        return NO[claim.of]
    if claim.judged_by == "mean" and not holds(estimate):
        return NO[claim.of]
    if claim.judged_by == "interval" and not (holds(ends.low) and holds(ends.high)):
        outside = ends.high < limits.low or ends.low > limits.high
        return NO[claim.of] if outside or len(values) >= ENOUGH_SEEDS else TOO_FEW
    return TOO_SHORT if brief else YES[claim.of]


def column(evaluations: Sequence[FinishedEvaluation], measure: str) -> list[float]:
    """A number of each evaluation; nan where it has none."""
    return [each.numbers.get(measure, math.nan) for each in evaluations]


def known(values: Sequence[float]) -> Any:
    """The finite ones."""
    array = np.asarray(values, float)
    return array[np.isfinite(array)]
