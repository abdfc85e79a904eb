"""Claims as data, and the verdict on each: the rule stands here once, and in words in docs/method.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from romgrl.results.evaluation_index import CADENCE_OFF, FinishedEvaluation
from romgrl.results.exact_tests import SIGNIFICANT, finite, paired_p, unpaired_p
from romgrl.results.statistics import (
    FEWEST_SEEDS,
    Interval,
    Summary,
    improvement_interval,
    probability_of_improvement,
    summarize,
)

CLAIMS = Path(__file__).with_name("claims.yaml")
TOO_FEW, TOO_SHORT, OTHER_CADENCES = "too few seeds", "evaluated too briefly", "cadences differ"
YES = {"paper": "reproduced", "project": "reached"}
NO = {"paper": "not reproduced", "project": "not reached"}
INTERVALS: dict[str, Callable[[float, float], tuple[float, float]]] = {
    "at_least": lambda value, tolerance: (value, math.inf),
    "above": lambda value, tolerance: (math.nextafter(value, math.inf), math.inf),
    "at_most": lambda value, tolerance: (-math.inf, value),
    "about": lambda value, tolerance: (value - tolerance, value + tolerance),
    "better": lambda value, tolerance: (0.0, SIGNIFICANT),  # of the paired p
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
    set: str
    value: float = math.nan
    tolerance: float = 0.0
    than: str | None = None
    way: str | None = None
    same_cadence: float | None = None
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
class Superiority:
    """How surely one number is better than another over seeds.

    paired, unpaired: exact p; improvement: the probability of improvement, with its interval.
    """

    paired: float
    unpaired: float
    improvement: float
    interval: Interval


@dataclass(frozen=True)
class Finding:
    """What the seeds say about a claim. `comparison`: of a claim that one number is better than another; else None."""

    claim: Claim
    values: tuple[float, ...]
    summary: Summary
    verdict: str
    comparison: Superiority | None = None


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
    summary, comparison = summarize(values), None
    estimate = summary.mean
    if claim.than is not None:
        assert claim.way in ("larger", "smaller")
        others = column(evaluations, claim.than)
        comparison = compare(values, others, larger=claim.way == "larger")
        estimate = comparison.paired
        values = [value + 0 * other for value, other in zip(values, others, strict=True)]
    brief = any(each.settings.get(key, 0) < least for each in evaluations for key, least in claim.needs.items())
    verdict = decide(claim, estimate, summary.mean_interval, values, brief=brief)
    if claim.same_cadence is not None and cadences_differ(evaluations, claim):
        verdict = OTHER_CADENCES
    return Finding(claim, tuple(values), summary, verdict, comparison)


def compare(ours: Sequence[float], theirs: Sequence[float], *, larger: bool) -> Superiority:
    """Tell how surely `ours` is better, larger or smaller; one number per seed of each, in the same order."""
    sign = 1.0 if larger else -1.0
    first, second = sign * np.asarray(ours, float), sign * np.asarray(theirs, float)
    samples = finite(first), finite(second)
    return Superiority(
        paired_p(first, second),
        unpaired_p(first, second),
        probability_of_improvement(*samples),
        improvement_interval(*samples),
    )


def cadences_differ(evaluations: Sequence[FinishedEvaluation], claim: Claim) -> bool:
    """Tell whether a walker of a claim has not the teacher's cadence in some seed, or has none."""
    walkers = {name.partition("/")[0] for name in (claim.measure, claim.than or claim.measure)}
    off = [each for walker in walkers for each in column(evaluations, f"{walker}/{CADENCE_OFF}")]
    return not all(each <= claim.same_cadence for each in off if claim.same_cadence is not None)


def decide(claim: Claim, estimate: float, ends: Interval, values: Sequence[float], *, brief: bool = False) -> str:
    """The verdict. nan among the values is a seed without the number, which counts against the claim.

    estimate: the mean of the values, or what is better the paired p; ends: the interval of the mean.
    """
    limits = claim.limits

    def holds(value: float) -> bool:
        return limits.low <= value <= limits.high

    if claim.judged_by == "every_seed" and any(not holds(value) for value in values):
        return NO[claim.of]
    if len(values) < FEWEST_SEEDS:
        return TOO_FEW
    if any(math.isnan(value) for value in values):
        return NO[claim.of]
    judged = {"interval": (ends.low, ends.high), "every_seed": ()}.get(claim.judged_by, (estimate,))
    if not all(map(holds, judged)):
        return NO[claim.of]
    return TOO_SHORT if brief else YES[claim.of]


def column(evaluations: Sequence[FinishedEvaluation], measure: str) -> list[float]:
    """A number of each evaluation; nan where it has none."""
    return [each.numbers.get(measure, math.nan) for each in evaluations]
