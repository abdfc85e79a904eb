"""What the robustness stages of a sweep came to: fall rates over seeds, table and curves, and the teachers' orbits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

import pandas as pd

from romgrl.artifacts import read_manifest
from romgrl.report.numbers import fixed
from romgrl.report.tables import markdown
from romgrl.report.terminal_tables import GROWING
from romgrl.results.seed_groups import by_group, seeds_told
from romgrl.results.sweep_cells import JobResult, located

STAGE = "robustness"
CURVES = "fall_rates"
BY_LEVEL = ["perturbation", "unit", "level", "walker"]


def disturbed(jobs: Sequence[JobResult], outputs: Path) -> list[Path]:
    """The robustness artifacts of the jobs that have one."""
    made = [Path(each.end.artifacts[STAGE]) for each in jobs if STAGE in each.end.artifacts]
    return [place for place in (located(outputs, path) for path in made) if place.is_dir()]


def write_disturbances(jobs: Sequence[JobResult], outputs: Path, directory: Path) -> list[str]:
    """Write fall_rates.csv and its figure; returns the text about them, none where no job was disturbed."""
    places = disturbed(jobs, outputs)
    if not places:
        return []
    from romgrl.report.fall_rate_figure import fall_rates  # matplotlib takes a second to import
    from romgrl.report.style import save

    groups = by_group(places, lambda place: read_manifest(place).seed)
    tables = [over_seeds([pd.read_csv(place / "robustness.csv") for place in members]) for members in groups.values()]
    tables[0].to_csv(directory / f"{CURVES}.csv", index=False)  # of held-out seeds, where there are any
    speed, count = float(read_manifest(places[0]).config["speed"]), len(next(iter(groups.values())))
    seeds = f"{count} seed{'s' if count > 1 else ''}"
    save(fall_rates(tables[0], speed, bands=f"smallest to largest of {seeds}"), directory, CURVES)
    text = []
    for members, table in zip(groups.values(), tables, strict=True):
        names = seeds_told([read_manifest(place).seed for place in members])
        text += [f"{names[0].upper()}{names[1:]}:", "", markdown(limits(table))]
    return [*text, orbits(jobs), ""]


def over_seeds(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """One row per disturbance, level and walker: the mean fall rate over seeds; low and high are the extremes."""
    rates = pd.concat(tables).groupby(BY_LEVEL, sort=False)
    return rates.agg(
        trials=("trials", "sum"), fall_rate=("fall_rate", "mean"), low=("fall_rate", "min"), high=("fall_rate", "max")
    ).reset_index()


def limits(table: pd.DataFrame) -> pd.DataFrame:
    """Fall rates of both walkers at the strongest level of each disturbance that the student mostly survives."""
    rows = []
    for name in table.perturbation.unique():
        of, label = table[table.perturbation == name], name.replace("_", " ")
        rates = of.pivot(index="level", columns="walker", values="fall_rate").sort_index()
        lost = rates.index[rates.student >= 0.5]
        held = rates.index[rates.index < lost[0]] if name in GROWING and len(lost) else rates.index
        for level in [held[-1]] if name in GROWING else [held[0], held[-1]]:
            falls = {walker: f"{fixed(100 * rates.loc[level, walker], 0)} %" for walker in ("student", "baseline")}
            rows.append({"disturbance": label, "level": f"{level:g}", "unit": of.unit.iloc[0], **falls})
    return pd.DataFrame(rows)


def orbits(jobs: Sequence[JobResult]) -> str:
    """The largest Floquet multiplier of the teachers over the seeds."""
    found = [each.numbers["teacher/multiplier"] for each in jobs if "teacher/multiplier" in each.numbers]
    if not found:
        return "No teacher has an orbit to measure."
    stable = sum(value < 1 for value in found)
    spread = f"{fmean(found):.2f} ({min(found):.2f} to {max(found):.2f})"
    return f"Largest Floquet multiplier of the teachers: {spread}; below 1, so stable, in {stable} of {len(found)}."
