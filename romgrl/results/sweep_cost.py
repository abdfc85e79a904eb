"""What a sweep cost: which jobs did best, how long each stage took, and what was not made again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from romgrl.artifacts import MANIFEST, Manifest
from romgrl.report.numbers import significant
from romgrl.report.tables import markdown
from romgrl.report.terminal_tables import run_link
from romgrl.results.evaluation_index import LINEAGE
from romgrl.results.sweep_cells import SEED_KEY, JobResult
from romgrl.results.sweep_record import Sweep

BEST = 5
REDUCTION, ERROR = "average/aligned/reduction_percent", "average/aligned/student"
BEST_COLUMNS = {
    REDUCTION: "reduction [%]",
    ERROR: "error, student [m²]",
    "weakest/aligned/reduction_percent": "weakest channel [%]",
    "student/falls_percent": "falls [%]",
    "student/steady_speed_m_per_s": "speed [m/s]",
}


def best_jobs(found: Sequence[JobResult]) -> list[str]:
    """The jobs with the largest reduction of the aligned error, or the smallest error where no job has a baseline to
    compare it with; each with a link to the run of its evaluation."""
    by, sign = (REDUCTION, -1) if any(REDUCTION in each.numbers for each in found) else (ERROR, 1)
    ranked = [each for each in found if each.evaluation and math.isfinite(each.numbers.get(by, math.nan))]
    ranked.sort(key=lambda each: sign * each.numbers[by])
    rows = []
    for each in ranked[:BEST]:
        manifest = each.evaluation.manifest if each.evaluation else None
        numbers = {label: significant(each.numbers.get(name, math.nan)) for name, label in BEST_COLUMNS.items()}
        seed = {} if manifest is None or SEED_KEY in each.swept else {SEED_KEY: manifest.seed}
        run = run_link(manifest.key, manifest.run_id) if manifest else ""
        rows.append({**each.swept, **seed, **numbers, "evaluation": run})
    return ["## Best jobs", "", markdown(pd.DataFrame(rows))] if rows else []


def cost(sweep: Sweep, found: Sequence[JobResult], outputs: Path) -> list[str]:
    """A row per stage: jobs that have it, artifacts that the sweep made or found, minutes that they took and saved."""
    rows = [row for stage in LINEAGE if (row := stage_cost(stage, sweep, found, outputs))]
    if not rows:
        return []
    made, saved = (sum(float(str(row[name])) for row in rows) for name in ("minutes", "minutes saved"))
    total = f"{made:.1f} minutes of training and measuring, one stage after the other; {saved:.1f} more were saved."
    return ["## Cost, and what was reused", "", markdown(pd.DataFrame(rows)), "", total]


def stage_cost(stage: str, sweep: Sweep, found: Sequence[JobResult], outputs: Path) -> dict[str, object]:
    """What a stage cost; nothing where no job has it. Saved is what each job would have needed for itself."""
    used = [*manifests(stage, found)]
    if not used:
        return {}
    distinct = {each.key: each for each in used}
    before = {key for key in distinct if made_before(outputs / "artifacts" / stage / key, sweep.started)}
    minutes = sum(each.wall_time for key, each in distinct.items() if key not in before) / 60
    return {
        "stage": stage,
        "jobs": len(used),
        "made": len(distinct) - len(before),
        "there before": len(before),
        "minutes": f"{minutes:.1f}",
        "minutes saved": f"{sum(each.wall_time for each in used) / 60 - minutes:.1f}",
    }


def manifests(stage: str, found: Sequence[JobResult]) -> Iterator[Manifest]:
    """The artifact of a stage that each job used."""
    for each in found:
        lineage = each.evaluation.lineage if each.evaluation is not None else {}
        yield from lineage.get(stage, [])[:1]


def made_before(directory: Path, started: float) -> bool:
    """Tell whether an artifact is older than the sweep; one that is gone does not count as made by it."""
    path = directory / MANIFEST
    return not path.exists() or path.stat().st_mtime < started
