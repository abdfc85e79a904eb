"""stage=verify: the paper's claims beside what finished evaluations of one configuration say. Nothing is trained."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import ALIGNMENTS, CHANNELS
from romgrl.provenance.shipped import is_pretrained
from romgrl.report.numbers import significant
from romgrl.results.claims import (
    ENOUGH_SEEDS,
    TOO_FEW,
    Finding,
    claims_for,
    column,
    finding_of,
    known,
    read_claims,
)
from romgrl.results.evaluation_index import FinishedEvaluation, Selection, codes, select
from romgrl.results.statistics import (
    Interval,
    improvement_interval,
    probability_of_improvement,
    summarize,
)
from romgrl.results.text_table import Sheet

WILD = 0.5  # coefficient of variation of the baseline's error over seeds from which a reduction says little
LISTED = 10  # reasons why evaluations are left out


def verify(config: Config, command: Sequence[str]) -> list[str | Sheet]:
    """What there is to print. `command`: the overrides of this run, repeated in the command that makes what is missing.

    Raises ArtifactError where no evaluation of this configuration is finished.
    """
    outputs = Path(config.paths.outputs)
    selection = select(outputs, config)
    one_seed = is_pretrained("student", config)  # what ships
    seeds = [] if one_seed else ["-m", f"seed={','.join(map(str, range(ENOUGH_SEEDS)))}"]
    rest = (text for text in command if text.partition("=")[0] not in ("stage", "seed"))
    making = shlex.join(["python", "-m", "romgrl", *seeds, *rest])
    if not selection.used:
        why = f" ({len(selection.left_out)} with other settings or damaged)" if selection.left_out else ""
        raise ArtifactError(f"{outputs}: no finished evaluation of this configuration{why}; {making} makes it")
    findings = [finding_of(claim, selection.used) for claim in claims_for(selection.used[0].settings, read_claims())]
    lines: list[str | Sheet] = [*origin_lines(config, selection)]
    if findings:
        lines.append(claims_sheet(findings))
    else:
        lines.append(f"no claim is made about {config.speed:g} m/s")
    lines += [errors_sheet(selection.used), baseline_sheet(selection.used), *warnings(selection.used)]
    if any(finding.verdict == TOO_FEW for finding in findings) and not one_seed:
        lines.append(f"more seeds: {making}")
    return lines


def origin_lines(config: Config, selection: Selection) -> list[str]:
    """Which evaluations count, and why others do not."""
    first, directory = selection.used[0].settings, selection.used[0].directory.parent
    episodes = f"{first['evaluation.episodes']} episodes of {first['evaluation.steps']} steps"
    seeds = plural(len(selection.used), "seed")
    lines = [f"verify: {config.speed:g} m/s, {seeds}, {episodes}, evaluations in {directory}"]
    for evaluation in selection.used:
        manifest = evaluation.manifest
        code = (manifest.revision or "unknown")[:10] + (" with changes" if manifest.dirty else "")
        lines.append(f"used: {manifest.key}, seed {manifest.seed}, digest {manifest.digest[:16]}, code {code}")
    reasons = Counter(selection.left_out.values()).most_common()
    for reason, count in reasons[:LISTED]:
        keys = [path.name for path, why in selection.left_out.items() if why == reason]
        lines.append(f"left out: {keys[0] if count == 1 else plural(count, 'evaluation')}: {reason}")
    if len(reasons) > LISTED:
        lines.append(f"left out: {sum(count for _, count in reasons[LISTED:])} evaluations for other reasons")
    return lines


def claims_sheet(findings: Sequence[Finding]) -> Sheet:
    """Claim by claim: what is expected, what was found, the verdict."""
    rows = []
    for finding in findings:
        claim = finding.claim
        found = ("P = " if claim.than is not None else "") + with_interval(finding.estimate, finding.interval)
        without = sum(map(math.isnan, finding.values))
        seeds = f"{len(finding.values)}" + (f" ({without} without)" if without else "")
        judged = claim.judged_by.replace("_", " ")
        rows.append((claim.id, claim.source, claim.expected, found, seeds, judged, finding.verdict))
    columns = ("claim", "by", "expected", "found", "seeds", "judged by", "verdict")
    names = ("claim", "by", "judged by", "verdict")
    return Sheet("Claims; in brackets the 95 % interval over seeds", columns, rows, names)


def errors_sheet(evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """Errors aligned and raw, their reduction as mean and interquartile mean, and the probability of improvement."""
    rows = []
    for alignment in ALIGNMENTS:
        for channel in (*CHANNELS, "average"):
            prefix = f"{channel}/{alignment}"
            student, baseline = (column(evaluations, f"{prefix}/{name}") for name in ("student", "baseline"))
            reduction = summarize(column(evaluations, f"{prefix}/reduction_percent"))
            ours, theirs = -known(student), -known(baseline)
            row = (
                f"{channel}, {alignment}",
                significant(summarize(baseline).mean),
                significant(summarize(student).mean),
                with_interval(reduction.mean, reduction.mean_interval),
                with_interval(reduction.iqm, reduction.iqm_interval),
                with_interval(probability_of_improvement(ours, theirs), improvement_interval(ours, theirs)),
            )
            rows.append(row)
    columns = ("channel", "baseline", "ROM-GRL", "reduction %", "IQM of it %", "P(improvement)")
    return Sheet("Error against the reference, mean over seeds (m²)", columns, rows, ("channel",))


def baseline_sheet(evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """How far the baseline's aligned error spreads over the seeds."""
    rows = []
    for channel in (*CHANNELS, "average"):
        summary = summarize(column(evaluations, f"{channel}/aligned/baseline"))
        numbers = (summary.mean, summary.deviation, summary.variation, summary.smallest, summary.largest)
        rows.append((channel, *map(significant, numbers)))
    columns = ("channel", "mean", "deviation", "variation", "smallest", "largest")
    return Sheet("Baseline's aligned error over seeds (m²)", columns, rows, ("channel",))


def warnings(evaluations: Sequence[FinishedEvaluation]) -> list[str]:
    """What makes the numbers above say less than they seem to."""
    lines = []
    summaries = {
        channel: summarize(column(evaluations, f"{channel}/aligned/baseline")) for channel in (*CHANNELS, "average")
    }
    wild = [f"{channel} {summary.variation:.0%}" for channel, summary in summaries.items() if summary.variation > WILD]
    if wild:
        lines.append(
            f"warning: the baseline varies wildly over seeds ({', '.join(wild)}; deviation above {WILD:.0%} of "
            "the mean): a reduction against it says little; compare the errors themselves"
        )
    fallen = [each.manifest.seed for each in evaluations if "average/aligned/reduction_percent" not in each.numbers]
    if fallen:
        lines.append(
            f"warning: seed {', '.join(map(str, fallen))}: student or baseline fell in more than half of the "
            "episodes, so there is no error to compare; it counts against every claim about errors"
        )
    if codes(evaluations) > 1:
        lines.append(f"warning: {codes(evaluations)} versions of code or libraries made these evaluations")
    return lines


def plural(number: int, noun: str) -> str:
    """`1 seed`, `2 seeds`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def with_interval(estimate: float, ends: Interval) -> str:
    """`66.1 [60.2, 71.3]`; without brackets where there is no interval."""
    text = significant(estimate)
    return text if math.isnan(ends.low) else f"{text} [{significant(ends.low)}, {significant(ends.high)}]"
