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
from romgrl.results.exact_tests import holm, paired_p, unpaired_p
from romgrl.results.seed_groups import held_out_or_all, seeds_told
from romgrl.results.statistics import FEWEST_SEEDS, Summary, summarize
from romgrl.results.sweep_cells import SEED_KEY, JobResult
from romgrl.results.sweep_record import Sweep, settings
from romgrl.results.text_table import BRACKETS, mean_text

FAIR, KEY = "fair", "comparison"  # the sweep, and what its jobs differ in
STUDENT, BASELINE = "student", "baseline"
WORTH = {
    "same_choice": (
        "What the imitation alone is worth",
        "which has its resets, the same choice of the policy and no imitation",
    ),
    "sinusoid": (
        "What the reduced-order model is worth beside cosines of its cadence and amplitudes",
        "which was taught by these",
    ),
}
"""The walkers that lack one thing which the student has: what that is worth, and who they are."""
NUMBERS_FILE = "against_student.csv"
SAID = (
    f"Error over variance, mean of the channels (a statue has 1); {BRACKETS}. Exact one-sided p that the student's is "
    "smaller, of the mean and the largest of any channel, uncorrected but in the last column; against_student.csv has "
    "every channel, with Holm's p over the channels."
)


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
    p_unpaired: float
    p_holm: float = math.nan


def write_against_student(sweep: Sweep, found: Sequence[JobResult], directory: Path) -> list[str]:
    """Write against_student.csv; returns a table of all walkers, and what imitation alone is worth if it is known."""
    text, rows = [], []
    for other, walkers in by_walker(found).items() if sweep.name == FAIR else ():
        compared = with_student(walkers)
        for name, (seeds, pairs) in compared.items():
            known = {KEY: name, "other": other}
            rows += [{**known, **numbers_of(pair), "seeds": " ".join(map(str, seeds))} for pair in pairs]
        if compared:
            text += [f"### In the student's place{f', {other}' if other else ''}", "", SAID, ""]
            text += [markdown(walkers_table(walkers, compared))]
        text += worth_of_each(walkers)
    if rows:
        pd.DataFrame(rows).to_csv(directory / NUMBERS_FILE, index=False)
    return text


def with_student(walkers: Mapping[str, Mapping[int, JobResult]]) -> dict[str, tuple[list[int], list[PairedErrors]]]:
    """What has shared seeds with the student, the baseline of its evaluations among it: those seeds and the errors."""
    student = walkers.get(STUDENT, {})
    return {
        name: (seeds, paired_errors(student, jobs, seeds, BASELINE if name == BASELINE else STUDENT))
        for name, jobs in {**walkers, BASELINE: student}.items()
        if name != STUDENT and (seeds := shared_seeds(student, jobs))
    }


def walkers_table(
    walkers: Mapping[str, Mapping[int, JobResult]], compared: Mapping[str, tuple[Sequence[int], Sequence[PairedErrors]]]
) -> pd.DataFrame:
    """One row per walker, the student first: errors, falls, how surely the student's errors are smaller."""
    student = walkers[STUDENT]
    own = held_out_or_all(sorted(student), lambda seed: seed)
    first = {channel: summarize(errors(student, channel, own)) for channel in (*CHANNELS, AVERAGE)}
    rows = [row_of(STUDENT, first, summarize(fall_shares(student, own, STUDENT)), own)]
    for name, (seeds, pairs) in compared.items():
        jobs, column = (student, BASELINE) if name == BASELINE else (walkers[name], STUDENT)
        row = row_of(
            name, {pair.channel: pair.walker for pair in pairs}, summarize(fall_shares(jobs, seeds, column)), seeds
        )
        row["student minus it"] = mean_text(pairs[-1].difference)
        row["p, paired"], row["p, unpaired"] = significant(pairs[-1].p), significant(pairs[-1].p_unpaired)
        row["p, unpaired, largest channel"] = significant(float(np.max([pair.p_unpaired for pair in pairs[:-1]])))
        row["without, student and it"] = f"{pairs[-1].without[0]} and {pairs[-1].without[1]}"
        rows.append(row)
    corrected = holm([pairs[-1].p for _, pairs in compared.values()])
    for row, p in zip(rows[1:], corrected, strict=True):
        row["p, paired, Holm over rows"] = significant(p)
    return pd.DataFrame(rows).fillna("")


def row_of(name: str, errors: Mapping[str, Summary], fallen: Summary, seeds: Sequence[int]) -> dict[str, str]:
    """What the table says of any walker."""
    worst = max(CHANNELS, key=lambda channel: errors[channel].mean)
    return {
        "walker": name,
        "seeds": ", ".join(map(str, seeds)),
        "error over variance": mean_text(errors[AVERAGE]),
        "largest channel": f"{significant(errors[worst].mean)} ({CHANNEL_LABELS[worst]})",
        "falls [%]": mean_text(fallen),
    }


def walker_of(job: JobResult) -> str:
    """What stands in the student's place in a job, whether its sweep varies that or not."""
    name = settings(job.end.overrides).get(KEY, job.swept.get(KEY, STUDENT))
    return STUDENT if name == "default" else name


def by_walker(found: Sequence[JobResult]) -> dict[str, dict[str, dict[int, JobResult]]]:
    """The finished jobs by what else they differ in, by what stands in the student's place, and by seed."""
    groups: dict[str, dict[str, dict[int, JobResult]]] = {}
    for each in found:
        if each.seed is not None and KEY in each.swept:
            other = ", ".join(f"{key}={value}" for key, value in each.swept.items() if key not in (KEY, SEED_KEY))
            walkers = groups.setdefault(other, {})
            walkers.setdefault(walker_of(each), {})[each.seed] = each
    return groups


def shared_seeds(ours: Mapping[int, JobResult], theirs: Mapping[int, JobResult]) -> list[int]:
    """The seeds that both have: the held-out ones, where there are any."""
    return held_out_or_all(sorted(ours.keys() & theirs.keys()), lambda seed: seed)


def paired_errors(
    student: Mapping[int, JobResult], other: Mapping[int, JobResult], seeds: Sequence[int], column: str = STUDENT
) -> list[PairedErrors]:
    """Channel by channel, and their mean; no p where the student lacks an error in a seed."""
    pairs = []
    for channel in (*CHANNELS, AVERAGE):
        every = [errors(student, channel, seeds), errors(other, channel, seeds, column)]
        without = sum(map(math.isnan, every[0])), sum(map(math.isnan, every[1]))
        ours, theirs = both_known(*every)
        smaller = [-value for value in ours], [-value for value in theirs]
        tests = (math.nan, math.nan) if without[0] else (paired_p(*smaller), unpaired_p(*smaller))
        difference = summarize(np.subtract(ours, theirs).tolist())
        pairs.append(PairedErrors(channel, summarize(ours), summarize(theirs), difference, without, *tests))
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
        "p_unpaired": pair.p_unpaired,
        "p_holm": pair.p_holm,
    }


def errors(jobs: Mapping[int, JobResult], channel: str, seeds: Sequence[int], column: str = STUDENT) -> list[float]:
    """The error over variance of a channel, or of all, in each seed; nan where there is none.

    column: student, as whatever stands in its place is called, or baseline.
    """
    return [jobs[seed].numbers.get(f"{OVER_VARIANCE}/{channel}/{column}", math.nan) for seed in seeds]


def fall_shares(jobs: Mapping[int, JobResult], seeds: Sequence[int], column: str) -> list[float]:
    """Per cent of the episodes that end in a fall, in each seed."""
    return [jobs[seed].numbers.get(f"{column}/falls_percent", math.nan) for seed in seeds]


def both_known(ours: Sequence[float], theirs: Sequence[float]) -> tuple[list[float], list[float]]:
    """The pairs of which neither is nan."""
    pairs = [pair for pair in zip(ours, theirs, strict=True) if math.isfinite(sum(pair))]
    return [mine for mine, _ in pairs], [other for _, other in pairs]


def worth_of_each(walkers: Mapping[str, Mapping[int, JobResult]]) -> list[str]:
    """A sentence for each of WORTH: the student's error against that of a training without it; none where one is
    missing, or the student has none in a seed."""
    return [line for name, said in WORTH.items() for line in worth(walkers, name, *said)]


def worth(walkers: Mapping[str, Mapping[int, JobResult]], name: str, what: str, who: str) -> list[str]:
    """What something is worth: the student's error against that of the walker `name`, who lacks it."""
    if not {STUDENT, name} <= walkers.keys():
        return []
    seeds = shared_seeds(walkers[STUDENT], walkers[name])
    every = [errors(walkers[each], AVERAGE, seeds) for each in (STUDENT, name)]
    ours, theirs = both_known(*every)
    pairs = len(ours)
    if not pairs or any(map(math.isnan, every[0])):
        return []
    difference = summarize(np.subtract(ours, theirs).tolist())
    p = paired_p([-value for value in ours], [-value for value in theirs])
    mine, other = (significant(float(np.mean(values))) for values in (ours, theirs))
    ends = "95 % interval in brackets" if pairs >= FEWEST_SEEDS else f"range in parentheses, {TOO_FEW}"
    return [
        f"{what}: the student's error over variance is {mine}, that of {name}, {who}, {other}; difference by seed "
        f"{mean_text(difference)} ({ends}), exact "
        f"one-sided p = {significant(p)}, {pairs} pair{'s' if pairs > 1 else ''} of {seeds_told(seeds)}.",
        "",
    ]
