"""Each walker in the student's place (sweeps/fair.yaml) against the student, seed by seed and channel by channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from romgrl.gait.features import CHANNELS
from romgrl.gait.null_models import AVERAGE, OVER_VARIANCE
from romgrl.report.numbers import UNKNOWN, significant
from romgrl.report.style import CHANNEL_LABELS
from romgrl.report.tables import markdown
from romgrl.results.claims import TOO_FEW
from romgrl.results.exact_tests import holm, paired_p
from romgrl.results.seed_groups import held_out_or_all, seeds_told
from romgrl.results.statistics import FEWEST_SEEDS, summarize
from romgrl.results.sweep_cells import SEED_KEY, JobResult
from romgrl.results.sweep_record import Sweep
from romgrl.results.text_table import mean_text

FAIR, KEY = "fair", "comparison"  # the sweep, and what its jobs differ in
STUDENT, WITHOUT_IMITATION = "student", "same_choice"
NUMBERS_FILE = "against_student.csv"
ROWS = {**CHANNEL_LABELS, AVERAGE: "mean"}


def write_against_student(sweep: Sweep, found: Sequence[JobResult], directory: Path) -> list[str]:
    """Write against_student.csv; returns a table for each walker, and what imitation alone is worth if it is known."""
    text, tables = [], []
    for other, walkers in by_walker(found).items() if sweep.name == FAIR else ():
        heading = f", {other}" if other else ""
        student = walkers.get(STUDENT, {})
        for name, jobs in walkers.items():
            seeds = [] if name == STUDENT else shared_seeds(student, jobs)
            if seeds:
                table = paired_table(student, jobs, name, seeds)
                tables.append(table.assign(comparison=name, seeds=" ".join(map(str, seeds)), other=other))
                said = f"Error over variance, {seeds_told(seeds)}; p: that the student's is smaller"
                text += [f"### student and {name}{heading}", "", f"{said}:", "", markdown(table)]
        text += worth_of_imitation(walkers)
    if tables:
        pd.concat(tables).to_csv(directory / NUMBERS_FILE, index=False)
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


def paired_table(
    student: Mapping[int, JobResult], other: Mapping[int, JobResult], name: str, seeds: Sequence[int]
) -> pd.DataFrame:
    """One row per channel: the mean errors of both where both have one, their difference seed by seed, and exact p.

    A walker that falls too often has no error: how many of each are without stands in the table, and there is no p
    where the student is one of them.
    """
    rows, values = [], []
    for channel in (*CHANNELS, AVERAGE):
        every = [errors(jobs, channel, seeds) for jobs in (student, other)]
        without = [sum(map(math.isnan, each)) for each in every]
        ours, theirs = both_known(*every)
        values.append(math.nan if without[0] else paired_p([-value for value in ours], [-value for value in theirs]))
        difference = summarize(np.subtract(ours, theirs).tolist())
        row: dict[str, object] = {"channel": ROWS[channel], "student": text_of(ours), name: text_of(theirs)}
        row |= {"student minus it": mean_text(difference), "pairs": len(ours)}
        rows.append(row | {"without, student and it": f"{without[0]} and {without[1]}"})
    table = pd.DataFrame(rows)
    table["p, paired"] = [*map(significant, values)]
    table["p, Holm over channels"] = [*map(significant, holm(values[:-1])), UNKNOWN]
    return table


def errors(jobs: Mapping[int, JobResult], channel: str, seeds: Sequence[int]) -> list[float]:
    """The error over variance of a channel, or of all, in each seed; nan where there is none."""
    name = f"{OVER_VARIANCE}/{channel}/{STUDENT}"  # whatever stands in the student's place is called so
    return [jobs[seed].numbers.get(name, math.nan) for seed in seeds]


def both_known(ours: Sequence[float], theirs: Sequence[float]) -> tuple[list[float], list[float]]:
    """The pairs of which neither is nan."""
    pairs = [pair for pair in zip(ours, theirs, strict=True) if math.isfinite(sum(pair))]
    return [mine for mine, _ in pairs], [other for _, other in pairs]


def text_of(values: Sequence[float]) -> str:
    """The mean with its interval or range."""
    return mean_text(summarize(values))


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
