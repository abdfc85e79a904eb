"""Each walker in the student's place (sweeps/fair.yaml) against the student, seed by seed and channel by channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from romgrl.gait.features import CHANNELS
from romgrl.gait.null_models import AVERAGE, OVER_VARIANCE
from romgrl.report.numbers import significant
from romgrl.report.style import CHANNEL_LABELS
from romgrl.report.tables import markdown
from romgrl.results.claims import TOO_FEW
from romgrl.results.exact_tests import holm, paired_p
from romgrl.results.seed_groups import held_out_or_all, seeds_told
from romgrl.results.statistics import FEWEST_SEEDS, Summary, summarize
from romgrl.results.sweep_cells import SEED_KEY, JobResult
from romgrl.results.sweep_record import Sweep
from romgrl.results.text_table import mean_text

FAIR, KEY = "fair", "comparison"  # the sweep, and what its jobs differ in
STUDENT, WITHOUT_IMITATION = "student", "same_choice"
NUMBERS_FILE = "against_student.csv"
ROWS = {**CHANNEL_LABELS, AVERAGE: "mean"}


@dataclass(frozen=True)
class PairedErrors:
    """Errors over variance of the student and of what stands in its place, of the seeds in which both have one.

    without: how many seeds the student and the other have no error in, because too many of their episodes fell.
    """

    channel: str
    student: Summary
    walker: Summary
    difference: Summary
    without: tuple[int, int]
    p: float
    p_holm: float = math.nan


def write_against_student(sweep: Sweep, found: Sequence[JobResult], directory: Path) -> list[str]:
    """Write against_student.csv; returns a table for each walker, and what imitation alone is worth if it is known."""
    text, rows = [], []
    for other, walkers in by_walker(found).items() if sweep.name == FAIR else ():
        heading = f", {other}" if other else ""
        student = walkers.get(STUDENT, {})
        for name, jobs in walkers.items():
            seeds = [] if name == STUDENT else shared_seeds(student, jobs)
            if seeds:
                pairs = paired_errors(student, jobs, seeds)
                rows += [
                    {KEY: name, "other": other, **numbers_of(pair), "seeds": " ".join(map(str, seeds))}
                    for pair in pairs
                ]
                said = f"Error over variance, {seeds_told(seeds)}; p: that the student's is smaller"
                text += [f"### student and {name}{heading}", "", f"{said}:", "", markdown(shown_pairs(pairs, name))]
        text += worth_of_imitation(walkers)
    if rows:
        pd.DataFrame(rows).to_csv(directory / NUMBERS_FILE, index=False)
    return text


def by_walker(found: Sequence[JobResult]) -> dict[str, dict[str, dict[int, JobResult]]]:
    """The finished jobs by what else they differ in, by what stands in the student's place, and by seed."""
    groups: dict[str, dict[str, dict[int, JobResult]]] = {}
    for each in found:
        if each.seed is not None and KEY in each.swept:
            name = each.swept[KEY]
            other = ", ".join(f"{key}={value}" for key, value in each.swept.items() if key not in (KEY, SEED_KEY))
            walkers = groups.setdefault(other, {})
            walkers.setdefault(STUDENT if name == "default" else name, {})[each.seed] = each
    return groups


def shared_seeds(ours: Mapping[int, JobResult], theirs: Mapping[int, JobResult]) -> list[int]:
    """The seeds that both have: the held-out ones, where there are any."""
    return held_out_or_all(sorted(ours.keys() & theirs.keys()), lambda seed: seed)


def paired_errors(
    student: Mapping[int, JobResult], other: Mapping[int, JobResult], seeds: Sequence[int]
) -> list[PairedErrors]:
    """Channel by channel, and their mean; no p where the student lacks an error in a seed."""
    pairs = []
    for channel in (*CHANNELS, AVERAGE):
        every = [errors(jobs, channel, seeds) for jobs in (student, other)]
        without = sum(map(math.isnan, every[0])), sum(map(math.isnan, every[1]))
        ours, theirs = both_known(*every)
        p = math.nan if without[0] else paired_p([-value for value in ours], [-value for value in theirs])
        difference = summarize(np.subtract(ours, theirs).tolist())
        pairs.append(PairedErrors(channel, summarize(ours), summarize(theirs), difference, without, p))
    corrected = holm([pair.p for pair in pairs[:-1]])
    return [replace(pair, p_holm=p) for pair, p in zip(pairs, [*corrected, math.nan], strict=True)]


def numbers_of(pair: PairedErrors) -> dict[str, object]:
    """A row of against_student.csv, empty where a number is not known."""
    ends = pair.difference.mean_interval
    return {
        "channel": pair.channel,
        "student": pair.student.mean,
        "walker": pair.walker.mean,
        "difference": pair.difference.mean,
        "low": ends.low,
        "high": ends.high,
        "pairs": len(pair.difference.values),
        "student_without": pair.without[0],
        "walker_without": pair.without[1],
        "p_paired": pair.p,
        "p_holm": pair.p_holm,
    }


def shown_pairs(pairs: Sequence[PairedErrors], name: str) -> pd.DataFrame:
    """The same to be read."""
    return pd.DataFrame(
        {
            "channel": ROWS[pair.channel],
            "student": mean_text(pair.student),
            name: mean_text(pair.walker),
            "student minus it": mean_text(pair.difference),
            "pairs": len(pair.difference.values),
            "without, student and it": f"{pair.without[0]} and {pair.without[1]}",
            "p, paired": significant(pair.p),
            "p, Holm over channels": significant(pair.p_holm),
        }
        for pair in pairs
    )


def errors(jobs: Mapping[int, JobResult], channel: str, seeds: Sequence[int]) -> list[float]:
    """The error over variance of a channel, or of all, in each seed; nan where there is none."""
    name = f"{OVER_VARIANCE}/{channel}/{STUDENT}"  # whatever stands in the student's place is called so
    return [jobs[seed].numbers.get(name, math.nan) for seed in seeds]


def both_known(ours: Sequence[float], theirs: Sequence[float]) -> tuple[list[float], list[float]]:
    """The pairs of which neither is nan."""
    pairs = [pair for pair in zip(ours, theirs, strict=True) if math.isfinite(sum(pair))]
    return [mine for mine, _ in pairs], [other for _, other in pairs]


def worth_of_imitation(walkers: Mapping[str, Mapping[int, JobResult]]) -> list[str]:
    """A sentence: the student's error against that of a training without imitation; none where one is missing, or the
    student has none in a seed."""
    if not {STUDENT, WITHOUT_IMITATION} <= walkers.keys():
        return []
    seeds = shared_seeds(walkers[STUDENT], walkers[WITHOUT_IMITATION])
    every = [errors(walkers[name], AVERAGE, seeds) for name in (STUDENT, WITHOUT_IMITATION)]
    ours, theirs = both_known(*every)
    pairs = len(ours)
    if not pairs or any(map(math.isnan, every[0])):
        return []
    difference = summarize(np.subtract(ours, theirs).tolist())
    p = paired_p([-value for value in ours], [-value for value in theirs])
    mine, other = (significant(float(np.mean(values))) for values in (ours, theirs))
    ends = "95 % interval in brackets" if pairs >= FEWEST_SEEDS else f"range in parentheses, {TOO_FEW}"
    return [
        f"What the imitation alone is worth: the student's error over variance is {mine}, that of {WITHOUT_IMITATION}, "
        f"which has its resets, the same choice of the policy and no imitation, {other}; difference by seed "
        f"{mean_text(difference)} ({ends}), exact "
        f"one-sided p = {significant(p)}, {pairs} pair{'s' if pairs > 1 else ''} of {seeds_told(seeds)}.",
        "",
    ]
