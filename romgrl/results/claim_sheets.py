"""The tables about claims: what was found, how sure comparisons are, and what other alignments say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from romgrl.gait.features import ALIGNMENTS, CHANNELS
from romgrl.report.numbers import significant
from romgrl.results.claims import OTHER_CADENCES, Finding, column
from romgrl.results.evaluation_index import FinishedEvaluation
from romgrl.results.exact_tests import holm
from romgrl.results.statistics import summarize
from romgrl.results.text_table import BRACKETS, Sheet, mean_text, with_interval

ALIGNED = "aligned"  # what the measures of the claims are named after
AVERAGE_ROW = "average"


def claim_sheets(findings: Sequence[Finding], evaluations: Sequence[FinishedEvaluation]) -> list[Sheet]:
    """All of them; without those that have no rows."""
    sheets = [claims_sheet(findings), superiority_sheet(findings), alignments_sheet(findings, evaluations)]
    return [sheet for sheet in sheets if sheet.rows]


def claims_sheet(findings: Sequence[Finding]) -> Sheet:
    """Claim by claim: what is expected and since when, what was found, the verdict."""
    rows = []
    for finding in findings:
        claim = finding.claim
        found = mean_text(finding.summary)
        if finding.comparison is not None:
            found = f"p = {significant(finding.comparison.paired)}, P = {significant(finding.comparison.improvement)}"
        without = sum(map(math.isnan, finding.values))
        seeds = f"{len(finding.values)}" + (f" ({without} without)" if without else "")
        judged = claim.judged_by.replace("_", " ")
        rows.append((claim.id, claim.source, claim.expected, claim.set, found, seeds, judged, finding.verdict))
    columns = ("claim", "by", "expected", "set", "found", "seeds", "judged by", "verdict")
    names = ("claim", "by", "set", "judged by", "verdict")
    title = f"Claims; {BRACKETS}; errors are aligned, the paper's probably not (it does not say)"
    return Sheet(title, columns, rows, names, file="claims")


def superiority_sheet(findings: Sequence[Finding]) -> Sheet:
    """What is claimed to be better: exact p, paired also corrected for all of them, and probability of improvement."""
    said = (each for each in findings if each.verdict != OTHER_CADENCES)
    found = [(each, each.comparison) for each in said if each.comparison is not None]
    counted = [comparison.paired for _, comparison in found]
    rows = [
        (
            finding.claim.id,
            significant(comparison.paired),
            significant(corrected),
            significant(comparison.unpaired),
            with_interval(comparison.improvement, comparison.interval),
            f"{len(finding.values)}",
        )
        for (finding, comparison), corrected in zip(found, holm(counted), strict=True)
    ]
    columns = ("comparison", "p, paired", "p, Holm", "p, unpaired", "P(improvement)", "seeds")
    many = sum(map(math.isfinite, counted))
    title = f"Comparisons; exact one-sided p, Holm: the paired one corrected for {many}"
    return Sheet(title, columns, rows, ("comparison",), file="comparisons")


def alignments_sheet(findings: Sequence[Finding], evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """Claims about errors by each alignment, and what the teacher gets there against itself."""
    rows = []
    for finding in findings:
        channel, slash, number = finding.claim.measure.partition(f"/{ALIGNED}/")
        if not slash or channel not in (*CHANNELS, AVERAGE_ROW):
            continue
        cells = []
        for alignment in ALIGNMENTS:
            ours = summarize(column(evaluations, f"{channel}/{alignment}/{number}"))
            floor = summarize(floors(evaluations, channel, alignment, number))
            cells += [significant(ours.mean), significant(floor.mean)]
        rows.append((finding.claim.id, finding.claim.expected, *cells))
    names = [alignment.replace("_", " ") for alignment in ALIGNMENTS]
    columns = ("claim", "expected", *(text for name in names for text in (name, f"{name}, teacher")))
    title = "The same by every alignment, mean over seeds; teacher: an episode of the reference against the others"
    return Sheet(title, columns, rows, ("claim",), file="alignments")


def floors(evaluations: Sequence[FinishedEvaluation], channel: str, alignment: str, number: str) -> list[float]:
    """The teacher's number in the place of a walker's: its own error, or that error's reduction of the baseline's."""

    def of(each: str, walker: str) -> np.ndarray:
        return np.array(column(evaluations, f"{each}/{alignment}/{walker}"))

    if number != "reduction_percent":
        return [*of(channel, "teacher_floor")]
    channels = CHANNELS if channel == AVERAGE_ROW else (channel,)  # the mean of the channels', as in the paper's table
    return [*np.mean([100.0 * (1.0 - of(each, "teacher_floor") / of(each, "baseline")) for each in channels], axis=0)]
