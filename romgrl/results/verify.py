"""stage=verify: the paper's claims beside what finished evaluations of one configuration say. Nothing is trained."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from romgrl.config.addresses import keeps_numbers
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import ALIGNMENTS, CHANNELS
from romgrl.provenance.shipped import is_pretrained
from romgrl.report.numbers import significant
from romgrl.results.claim_sheets import claim_sheets
from romgrl.results.claims import TOO_FEW, claims_for, column, compare, finding_of, read_claims
from romgrl.results.evaluation_index import FinishedEvaluation, Selection, codes, select
from romgrl.results.seed_groups import CHOSEN, CHOSEN_SEEDS, group_of, held_out_or_all, seeds_told
from romgrl.results.statistics import FEWEST_SEEDS, summarize
from romgrl.results.text_table import BRACKETS, Sheet, mean_text, middle_text, with_interval
from romgrl.results.walker_sheets import gait_sheet, nulls_sheet

WILD = 0.5  # coefficient of variation of the baseline's error over seeds from which a reduction says little
LISTED = 10  # reasons why evaluations are left out


def verify(config: Config, command: Sequence[str]) -> list[str | Sheet]:
    """What there is to print. `command`: the overrides of this run, repeated in the command that makes what is missing.

    Raises ArtifactError where no evaluation of this configuration is finished.
    """
    outputs = Path(config.paths.outputs)
    selection = select(outputs, config)
    one_seed = is_pretrained("student", config)  # what ships
    dropped = {"stage", "seed", *(["paths.outputs"] if keeps_numbers(outputs) else [])}
    rest = [text for text in command if text.partition("=")[0] not in dropped]
    making = shlex.join(["python", "-m", "romgrl", *([] if one_seed else seeds_wanted(selection.seeds)), *rest])
    if not selection.used:
        why = f" ({len(selection.left_out)} with other settings or damaged)" if selection.left_out else ""
        raise ArtifactError(f"{outputs}: no finished evaluation of this configuration{why}; {making} makes it")
    counted = held_out_or_all(selection.used, lambda each: each.manifest.seed)
    findings = [finding_of(claim, counted) for claim in claims_for(counted[0].settings, read_claims())]
    lines: list[str | Sheet] = [*origin_lines(config, selection)]
    lines.append(f"the numbers below are of {seeds_told([each.manifest.seed for each in counted])}")
    if findings:
        lines += claim_sheets(findings, counted)
    else:
        lines.append(f"no claim is made about {config.speed:g} m/s")
    lines += [nulls_sheet(counted), gait_sheet(counted)]
    lines += [errors_sheet(counted), baseline_sheet(counted), *warnings(counted)]
    if any(finding.verdict == TOO_FEW for finding in findings) and not one_seed:
        lines.append(f"more seeds: {making}")
    return lines


def seeds_wanted(seeds: Sequence[int]) -> list[str]:
    """Overrides that make enough seeds: held-out ones, unless all that there are chose the settings."""
    chosen = seeds and all(group_of(seed) == CHOSEN for seed in seeds)
    first = CHOSEN_SEEDS.start if chosen else CHOSEN_SEEDS.stop
    return ["-m", f"seed={','.join(map(str, range(first, first + FEWEST_SEEDS)))}"]


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


def errors_sheet(evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """Errors by alignment, their reduction as mean and interquartile mean, how surely they are below the baseline's."""
    rows = []
    for alignment in ALIGNMENTS:
        for channel in (*CHANNELS, "average"):
            prefix = f"{channel}/{alignment}"
            student, baseline = (column(evaluations, f"{prefix}/{name}") for name in ("student", "baseline"))
            reduction = summarize(column(evaluations, f"{prefix}/reduction_percent"))
            floor = summarize(column(evaluations, f"{prefix}/teacher_floor"))
            comparison = compare(student, baseline, larger=False)
            row = (
                f"{channel}, {alignment}",
                significant(summarize(baseline).mean),
                significant(summarize(student).mean),
                significant(floor.mean),
                mean_text(reduction),
                middle_text(reduction),
                with_interval(comparison.improvement, comparison.interval),
                significant(comparison.paired),
                significant(comparison.unpaired),
            )
            rows.append(row)
    columns = ("channel", "baseline", "student", "teacher", "reduction %", "IQM of it %", "P(improvement)")
    title = f"Error against the reference, mean over seeds (m²); {BRACKETS}; exact one-sided p, uncorrected"
    return Sheet(title, (*columns, "p, paired", "p, unpaired"), rows, ("channel",), file="errors")


def baseline_sheet(evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """How far the baseline's aligned error spreads over the seeds."""
    rows = []
    for channel in (*CHANNELS, "average"):
        summary = summarize(column(evaluations, f"{channel}/aligned/baseline"))
        numbers = (summary.mean, summary.deviation, summary.variation, summary.smallest, summary.largest)
        rows.append((channel, *map(significant, numbers)))
    columns = ("channel", "mean", "deviation", "variation", "smallest", "largest")
    return Sheet("Baseline's aligned error over seeds (m²)", columns, rows, ("channel",), file="baseline")


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
