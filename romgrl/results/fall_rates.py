"""What the robustness stages of a sweep came to: fall rates over seeds, table and curves, and the teachers' orbits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import pandas as pd

from romgrl.artifacts import Manifest, read_manifest
from romgrl.report.numbers import UNKNOWN, fixed
from romgrl.report.tables import markdown
from romgrl.report.terminal_tables import GROWING
from romgrl.results.against_student import BASELINE, STUDENT, walker_of
from romgrl.results.seed_groups import by_group, seeds_told
from romgrl.results.sweep_cells import JobResult, located

STAGE = "robustness"
CURVES = "fall_rates"
BY_LEVEL = ["perturbation", "unit", "level", "walker"]


@dataclass(frozen=True)
class Disturbed:
    """A robustness artifact, and which walker stood in the student's place."""

    walker: str
    directory: Path
    manifest: Manifest

    @property
    def table(self) -> pd.DataFrame:
        """Its robustness.csv by the names of the walkers."""
        return pd.read_csv(self.directory / "robustness.csv").replace({"walker": {STUDENT: self.walker}})


def with_one_baseline(members: Sequence[Disturbed]) -> list[pd.DataFrame]:
    """The tables of some artifacts, with the baseline of a seed, which they share, from the first of them alone."""
    tables, seeds = [], set()
    for each in sorted(members, key=lambda one: in_order(one.walker)):
        known = each.manifest.seed in seeds
        tables.append(each.table[each.table.walker != BASELINE] if known else each.table)
        seeds.add(each.manifest.seed)
    return tables


def disturbed(jobs: Sequence[JobResult], outputs: Path) -> list[Disturbed]:
    """The robustness artifacts of the jobs that have one; none that is damaged."""
    made = []
    for each in jobs:
        if STAGE in each.end.artifacts and each.error is None:
            place = located(outputs, Path(each.end.artifacts[STAGE]))
            if place.is_dir():
                made.append(Disturbed(walker_of(each), place, read_manifest(place)))
    return made


def write_disturbances(jobs: Sequence[JobResult], outputs: Path, directory: Path) -> list[str]:
    """Write fall_rates.csv and its figure; returns the text about them, none where no job was disturbed."""
    found = disturbed(jobs, outputs)
    if not found:
        return []
    from romgrl.report.fall_rate_figure import fall_rates  # matplotlib takes a second to import
    from romgrl.report.style import save

    groups = by_group(found, lambda each: each.manifest.seed)
    tables = [over_seeds(with_one_baseline(members)) for members in groups.values()]
    tables[0].to_csv(directory / f"{CURVES}.csv", index=False)  # of held-out seeds, where there are any
    speed, count = found[0].manifest.config["speed"], len({each.manifest.seed for each in next(iter(groups.values()))})
    seeds = f"{count} seed{'s' if count > 1 else ''}"
    save(fall_rates(tables[0], float(speed), bands=f"smallest to largest of {seeds}"), directory, CURVES)
    text = []
    for members, table in zip(groups.values(), tables, strict=True):
        names = seeds_told([each.manifest.seed for each in members])
        text += [f"{names[0].upper()}{names[1:]}:", "", markdown(limits(table))]
    return [*text, orbits(jobs), ""]


def over_seeds(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """One row per disturbance, level and walker: the mean fall rate over seeds; low and high are the extremes."""
    rates = pd.concat(tables).groupby(BY_LEVEL, sort=False)
    table = rates.agg(
        trials=("trials", "sum"), fall_rate=("fall_rate", "mean"), low=("fall_rate", "min"), high=("fall_rate", "max")
    ).reset_index()
    return table.sort_values("walker", key=lambda walkers: walkers.map(in_order), kind="stable")


def in_order(walker: str) -> int:
    """Where a walker stands in tables and figures: the student, what stands in its place, the baseline."""
    return {STUDENT: 0, BASELINE: 2}.get(walker, 1)


def limits(table: pd.DataFrame) -> pd.DataFrame:
    """Fall rates of all walkers at the strongest level of each disturbance that the first of them mostly survives.

    Means over seeds, and in brackets the smallest and largest.
    """
    rows, walkers = [], table.walker.unique()
    for name in table.perturbation.unique():
        of, label = table[table.perturbation == name], name.replace("_", " ")
        rates = of.pivot(index="level", columns="walker", values="fall_rate").sort_index()
        lost = rates.index[rates[walkers[0]] >= 0.5]
        held = rates.index[rates.index < lost[0]] if name in GROWING and len(lost) else rates.index
        held = held if len(held) else rates.index[:1]  # it falls at the weakest level, too
        for level in [held[-1]] if name in GROWING else dict.fromkeys([held[0], held[-1]]):
            falls = of[of.level == level].set_index("walker")
            told = {walker: share_of(*falls.loc[walker, ["fall_rate", "low", "high"]]) for walker in walkers}
            rows.append({"disturbance": label, "level": f"{level:g}", "unit": of.unit.iloc[0], **told})
    return pd.DataFrame(rows)


def share_of(rate: float, low: float, high: float) -> str:
    """A fall rate as `20 % (0 to 40)`, or `20 %` where all are the same; a dash where there is none."""
    if not math.isfinite(rate):
        return UNKNOWN
    spread = f" ({fixed(100 * low, 0)} to {fixed(100 * high, 0)})" if high > low else ""
    return f"{fixed(100 * rate, 0)} %{spread}"


def orbits(jobs: Sequence[JobResult]) -> str:
    """The largest Floquet multiplier of the teachers over the seeds."""
    found = sorted({each.numbers["teacher/multiplier"] for each in jobs if "teacher/multiplier" in each.numbers})
    if not found:
        return "No teacher has an orbit to measure."
    stable = sum(value < 1 for value in found)
    spread = f"{fmean(found):.2f} ({min(found):.2f} to {max(found):.2f})"
    return f"Largest Floquet multiplier of the teachers: {spread}; below 1, so stable, in {stable} of {len(found)}."
