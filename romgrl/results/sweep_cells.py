"""The jobs of a sweep as tables: one row per job, and one row per cell and number with its statistics over seeds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from romgrl.errors import ArtifactError
from romgrl.gait.distances import FLOOR
from romgrl.gait.features import CHANNELS
from romgrl.gait.measures import SWEPT
from romgrl.gait.null_models import AVERAGE, MEAN_ERROR, OVER_VARIANCE, REDUCTIONS, SCORED
from romgrl.report.grid_tables import evaluation_metrics, grid_names, is_grid
from romgrl.report.library_table import library_metrics
from romgrl.report.terminal_tables import result_metrics, robustness_metrics, with_falls
from romgrl.results.claims import TOO_FEW, compare
from romgrl.results.evaluation_index import (
    TEACHER,
    TOUCHDOWNS,
    TRAINING_STEPS,
    Catalogue,
    FinishedEvaluation,
    catalogue,
    manifest_of,
    read_evaluation,
)
from romgrl.results.kept import open_numbers
from romgrl.results.seed_groups import by_group, held_out_or_all
from romgrl.results.statistics import FEWEST_SEEDS, summarize
from romgrl.results.sweep_record import JobEnd, Sweep, settings

SEED_KEY = "seed"
ERROR_NUMBERS = [f"{channel}/aligned" for channel in (*CHANNELS, "average")] + ["average/one_episode", "average/raw"]
BASELINE = "average/aligned/baseline"  # missing where too many of the baseline's episodes fell
DISTANCE_NUMBERS = ["mmd/all", "wasserstein/all", "dtw/all"]
READ = ("robustness", "teacher", "library")
"""Stages whose tables are read here; evaluations are verified where they are read."""
WALKED, COMPARED = ("student", "baseline"), ("teacher", "student", "baseline")
SUMMARISED = (*COMPARED, TEACHER)
NULLS = [walker for walker in SCORED if walker not in WALKED]
NUMBERS = [
    *(f"{name}/reduction_percent" for name in ERROR_NUMBERS),
    "weakest/aligned/reduction_percent",
    *(f"{name}/{walker}" for name in [*ERROR_NUMBERS, *DISTANCE_NUMBERS] for walker in (*WALKED, FLOOR)),
    *(f"{measure}/{AVERAGE}/{walker}" for measure in (OVER_VARIANCE, *REDUCTIONS.values()) for walker in NULLS),
    *(f"{measure}/{MEAN_ERROR}/{walker}" for measure in REDUCTIONS.values() for walker in ("student", *NULLS)),
    *(f"{name}/{walker}" for name in DISTANCE_NUMBERS for walker in NULLS),
    *(f"{OVER_VARIANCE}/{channel}/{walker}" for channel in CHANNELS for walker in COMPARED),
    *(f"{walker}/{name}" for walker in SUMMARISED for name in (*SWEPT, TOUCHDOWNS)),
    "student/stride_frequency_deviation_percent",
    *("library/cells", "library/fit_percent", "library/largest_multiplier"),
    *grid_names(),
]


@dataclass(frozen=True)
class JobResult:
    """A job: the values of the swept keys, how it ended, its numbers and the evaluation that they are from."""

    swept: dict[str, str]
    end: JobEnd
    numbers: dict[str, float]
    evaluation: FinishedEvaluation | None = None
    error: str | None = None
    short: tuple[str, ...] = ()

    @property
    def cell(self) -> tuple[str, ...]:
        """The values of all swept keys but the seed."""
        return tuple(value for key, value in self.swept.items() if key != SEED_KEY)

    @property
    def seed(self) -> int | None:
        """The seed of its student; None of a job that evaluates none."""
        return None if self.evaluation is None else self.evaluation.manifest.seed


def of_students(cells: pd.DataFrame) -> bool:
    """Tell whether cells have numbers of students; those of a sweep over teachers have none."""
    return bool(cells["number"].str.contains("student/|reduction_percent").any())


def results(sweep: Sweep, outputs: Path, known: Catalogue | None = None) -> list[JobResult]:
    """Every job of a sweep; known: what `catalogue` found under outputs, where it has been asked already."""
    known = catalogue(outputs) if known is None else known
    return [result(sweep, job, outputs, known) for job in sweep.jobs]


def result(sweep: Sweep, job: list[str], outputs: Path, known: Catalogue) -> JobResult:
    """One job, with the numbers of its evaluation, or of its teacher where it went no further."""
    end = sweep.end_of(job)
    own = settings(job)
    swept = {key: own.get(key, "default") for key in sweep.swept}
    if end.error is not None:
        return JobResult(swept, end, {}, error=end.error.replace(f"{outputs}/", ""))
    places = {stage: located(outputs, Path(path)) for stage, path in end.artifacts.items()}
    try:
        for stage, place in places.items():
            if stage in READ:
                open_numbers(place, stage=stage)
        if "robustness" in places:
            return JobResult(swept, end, robustness_metrics(places["robustness"]))
        if "evaluation" in places and is_grid(places["evaluation"]):
            open_numbers(places["evaluation"], stage="evaluation")
            return JobResult(swept, end, evaluation_metrics(places["evaluation"]))
        if "evaluation" in places:
            evaluation = read_evaluation(places["evaluation"], known)
            short = short_budgets(evaluation.settings, sweep.usual)
            return JobResult(swept, end, evaluation.numbers, evaluation, short=short)
        if "teacher" in places:
            short = short_budgets(manifest_of(places["teacher"]).config, sweep.usual)
            numbers = with_falls(result_metrics(places["teacher"]))
            if "library" in places:
                numbers |= {f"library/{name}": value for name, value in library_metrics(places["library"]).items()}
            return JobResult(swept, end, numbers, short=short)
    except ArtifactError as error:
        return JobResult(swept, end, {}, error=str(error).replace(f"{outputs}/", ""))
    return JobResult(swept, end, {})


def located(outputs: Path, path: Path) -> Path:
    """Where an artifact is in these outputs, which may be a copy from another place."""
    return outputs / "artifacts" / path.parent.name / path.name


def short_budgets(made_with: Mapping[str, Any], usual: Mapping[str, float]) -> tuple[str, ...]:
    """The settings that are below their usual value, as `student.total_steps 1000 of 200000`."""
    return tuple(
        f"{key} {made_with[key]} of {steps}" for key, steps in usual.items() if made_with.get(key, steps) < steps
    )


def jobs_table(found: list[JobResult]) -> pd.DataFrame:
    """One row per job: swept values, how it ended, artifact, digest, hours of its stages, all of its numbers."""
    rows = []
    for each in found:
        row: dict[str, Any] = {**each.swept, "ended": each.error or "finished", "budget": "; ".join(each.short)}
        if each.evaluation is not None:
            manifest = each.evaluation.manifest
            row |= {"evaluation": manifest.key, "digest": manifest.digest, "code": manifest.revision}
            row["training_minutes"] = round(training_seconds(each.evaluation) / 60, 2)
        rows.append(row | each.numbers)
    return pd.DataFrame(rows)


def training_seconds(evaluation: FinishedEvaluation) -> float:
    """Wall time of all stages behind an evaluation, one after the other, on the machine that made them."""
    return sum(several[0].wall_time for several in evaluation.lineage.values())


def by_cell(found: Iterable[JobResult]) -> list[list[JobResult]]:
    """The jobs that ended well, cell by cell."""
    cells: dict[tuple[str, ...], list[JobResult]] = {}
    for each in found:
        if each.error is None:
            cells.setdefault(each.cell, []).append(each)
    return [*cells.values()]


def headline_jobs(found: Iterable[JobResult]) -> list[JobResult]:
    """Of each cell the jobs of held-out seeds, where there are any; all of them otherwise."""
    return [each for several in by_cell(found) for each in held_out_or_all(several, seed_of)]


def seed_of(job: JobResult) -> int | None:
    """The seed of a job's student."""
    return job.seed


def cells_table(found: list[JobResult]) -> pd.DataFrame:
    """One row per cell, group of seeds and number: its statistics over seeds."""
    rows = []
    for several in by_cell(found):
        swept = {key: value for key, value in several[0].swept.items() if key != SEED_KEY}
        for group, members in by_group(several, seed_of).items():
            numbers = (number_row(members, measure, group) for measure in NUMBERS)
            rows += [swept | row for row in numbers if row]
    return pd.DataFrame(rows)


def number_row(several: list[JobResult], measure: str, group: str) -> dict[str, Any]:
    """The statistics of one number over the seeds of a group; none where no seed has it."""
    values = [each.numbers.get(measure, math.nan) for each in several]
    summary = summarize(values)
    if not len(summary.values):
        return {}
    row: dict[str, Any] = {
        "number": measure,
        "group": group,
        "seeds": summary.seeds,
        "without": summary.missing,
        "mean": summary.mean,
        "low": summary.mean_interval.low,
        "high": summary.mean_interval.high,
        "iqm": summary.iqm,
        "iqm_low": summary.iqm_interval.low,
        "iqm_high": summary.iqm_interval.high,
        "deviation": summary.deviation,
        "smallest": summary.smallest,
        "largest": summary.largest,
    }
    row |= improvement(several, measure)
    return row | {"note": note(several)}


def improvement(several: list[JobResult], measure: str) -> dict[str, float]:
    """How surely the student's error or distance is below the baseline's."""
    if not measure.endswith("/student") or measure.partition("/")[0] in (*REDUCTIONS.values(), "grid"):
        return {}
    other = measure.removesuffix("student") + "baseline"
    ours, theirs = ([each.numbers.get(name, math.nan) for each in several] for name in (measure, other))
    found = compare(ours, theirs, larger=False)
    if not math.isfinite(found.improvement):
        return {}
    return {
        "improvement": found.improvement,
        "improvement_low": found.interval.low,
        "improvement_high": found.interval.high,
        "paired_p": found.paired,
        "unpaired_p": found.unpaired,
    }


def made_again(job: JobResult) -> bool:
    """Tell whether the student of a job made a part of its steps again (`student.second_try`)."""
    total = math.inf if job.evaluation is None else job.evaluation.settings.get("student.total_steps", math.inf)
    return job.numbers.get(TRAINING_STEPS, 0.0) > 1.01 * total  # the last pass may go a little beyond


def note(several: list[JobResult]) -> str:
    """What must stand beside the numbers of a cell."""
    alone = any("baseline/falls_percent" in each.numbers and BASELINE not in each.numbers for each in several)
    said = {
        "one seed": len(several) == 1,
        TOO_FEW: 1 < len(several) < FEWEST_SEEDS,
        "short budget": any(each.short for each in several),
        "baseline falls": alone,
        "steps made again": any(made_again(each) for each in several),
    }
    return ", ".join(text for text, true in said.items() if true)
