"""The README's table: what the paper's sweep and the walking one came to, one column per speed and teacher."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from romgrl.errors import ArtifactError
from romgrl.gait.distances import FLOOR
from romgrl.gait.features import ALIGNMENTS, ALL, CHANNELS
from romgrl.gait.null_models import AVERAGE, MEAN_ERROR, OVER_VARIANCE, REDUCTIONS
from romgrl.report.numbers import fixed
from romgrl.report.style import CHANNEL_LABELS
from romgrl.report.tables import DISTANCE_LABELS, markdown
from romgrl.results.against_student import FAIR, by_walker, walkers_table, with_student, worth_of_each
from romgrl.results.results_document import CLAIMED, FinishedSweeps
from romgrl.results.seed_groups import CHOSEN, HELD_OUT, group_of
from romgrl.results.sweep_cells import SEED_KEY, JobResult, by_cell, headline_jobs, note
from romgrl.results.sweep_record import settings
from romgrl.results.sweep_tables import walked
from romgrl.results.text_table import BRACKETS

FAIR_COLUMNS = (
    "walker",
    "seeds",
    "error over variance",
    "largest channel",
    "falls [%]",
    "p, unpaired, largest channel",
)
FAIR_SAID = (
    f"What else may stand in the student's place (`sweeps/fair.yaml`), with its budget; {BRACKETS}. p: exact, one-"
    "sided, that the student's error is smaller, of the channel in which that is least sure; uncorrected, "
    "docs/results.md has Holm's, and the seeds without an error"
)
OTHER_SETTINGS = (
    "paper_discriminator",
    "humenv",
    "experiment_paper",
    "variable_running",
    "variable_walking",
    "hopping",
)  # sweeps of students that are not the default's, by their names in sweeps/
NOT_NAMED = (SEED_KEY, "humanoid.xml")
"""Settings of a job that its row does not name: the seed has a column, the file is the sweep."""
OTHER_SAID = f"Other settings than the defaults, each a stored sweep; {BRACKETS}:"
START, END = "<!-- results -->", "<!-- end of results -->"
GAIT = {
    "falls_percent": ("episodes of 33 s with a fall [%]", 1),
    "steady_speed_m_per_s": ("steady speed [m/s]", 2),
    "trunk_lean_deg": ("trunk lean, forward positive [deg]", 0),
    "stride_frequency_hz": ("strides [Hz]", 2),
}
README_ROWS = {
    "average/aligned/reduction_percent": ("aligned error, average: reduction [%]", 1),
    **{
        f"{channel}/aligned/reduction_percent": (f"aligned error, {CHANNEL_LABELS[channel]}: reduction [%]", 1)
        for channel in CHANNELS
    },
    "average/one_episode/reduction_percent": (f"error, {ALIGNMENTS['one_episode']}, average: reduction [%]", 1),
    "average/raw/reduction_percent": ("raw error, average: reduction [%]", 1),
    f"{REDUCTIONS['aligned']}/{MEAN_ERROR}/student": ("aligned error, mean of the channels: reduction [%]", 1),
    f"{REDUCTIONS['aligned']}/{AVERAGE}/sinusoid": ("the same average of a sinusoid [%]", 1),
    f"{REDUCTIONS['aligned']}/{AVERAGE}/statue": ("the same average of a statue [%]", 1),
    **{f"{walker}/{OVER_VARIANCE}": (f"{walker}: error over variance", 2) for walker in ("student", "baseline")},
    f"teacher/{OVER_VARIANCE}": ("teacher against itself: error over variance", 2),
    **{f"{OVER_VARIANCE}/{AVERAGE}/{null}": (f"{null}: error over variance", 2) for null in ("sinusoid", "statue")},
    **{
        f"{distance}/{ALL}/{column}": (f"{walker}: {label}", decimals)
        for distance, (label, decimals) in DISTANCE_LABELS.items()
        for column, walker in (("student", "student"), ("baseline", "baseline"), (FLOOR, "teacher against itself"))
    },
    "teacher/stride_frequency_hz": ("teacher: strides [Hz]", 2),
    **{
        f"{walker}/{name}": (f"{walker}: {label}", decimals)
        for walker in ("student", "baseline")
        for name, (label, decimals) in GAIT.items()
    },
}  # the number, its label and its decimals


def readme_text(found: FinishedSweeps, outputs: Path, document: Path) -> str:
    """The text with the table between its markers. Raises ArtifactError where there is no such sweep or place."""
    jobs: dict[str, list[JobResult]] = {}
    for sweep, finished in found:
        several = finished if sweep.name in CLAIMED else []
        jobs.setdefault(sweep.on, []).extend(each for each in several if each.evaluation is not None)
    if not any(jobs.values()):
        raise ArtifactError(f"{outputs}: no job of the sweeps {' and '.join(CLAIMED)} has finished")
    try:
        before, _, rest = document.read_text(encoding="utf-8").partition(START)
    except UnicodeDecodeError as error:
        raise ArtifactError(f"{document}: is no text in UTF-8") from error
    if END not in rest:
        raise ArtifactError(f"{document}: has no markers {START} and {END}")
    table = pd.concat([runs_table(several, on) for on, several in jobs.items() if several], axis=1)
    text = "\n".join([markdown(table.loc[:, ~table.columns.duplicated()]), *fair_table(found), *others_table(found)])
    return f"{before}{START}\n\n{text}\n{END}{rest.partition(END)[2]}"


def fair_table(found: FinishedSweeps) -> list[str]:
    """What stands in the student's place, beside it, and what the imitation alone is worth; none without that sweep."""
    text = []
    for sweep, finished in found:
        for other, walkers in by_walker(finished).items() if sweep.name == FAIR else ():
            if compared := with_student(walkers):
                table = walkers_table(walkers, compared)
                shown = [column for column in FAIR_COLUMNS if column in table]
                where = f"On {sweep.on}, other bits and so other trainings, the same way" if sweep.on else FAIR_SAID
                title = f"{where}; {other}:" if other else f"{where}:"
                text += [title, "", markdown(table[shown]), *worth_of_each(walkers)]
    return text


def others_table(found: FinishedSweeps) -> list[str]:
    """What students of other settings came to, a row per cell of the sweeps of OTHER_SETTINGS; nothing without any."""
    rows = []
    for sweep, finished in found:
        for cell in by_cell(headline_jobs(finished if sweep.name in OTHER_SETTINGS else [])):
            of = settings(cell[0].end.overrides) | cell[0].swept
            named = [f"{key}={value}" for key, value in of.items() if key not in NOT_NAMED]
            row = {"settings": ", ".join([sweep.name, *named, *([f"on {sweep.on}"] if sweep.on else [])])}
            row["seeds"] = ", ".join(sorted(str(each.seed) for each in cell))
            rows.append(row | walked(cell) | {"note": note(cell)})
    return [OTHER_SAID, "", markdown(pd.DataFrame(rows))] if rows else []


def runs_table(jobs: Sequence[JobResult], on: str = "") -> pd.DataFrame:
    """One row per number, one column per speed, teacher and group of seeds: mean over seeds, smallest and largest.

    on: the processor, where that is another one than that of the first trainings.
    """
    groups: dict[tuple[float, float, bool], list[JobResult]] = {}
    for each in jobs:
        assert each.evaluation is not None
        of = each.evaluation.settings
        held_out = group_of(each.evaluation.manifest.seed) == HELD_OUT
        groups.setdefault((float(of["speed"]), float(of["teacher.speed"]), held_out), []).append(each)
    table = {"mean (smallest to largest)": [label for label, _ in README_ROWS.values()]}
    for (speed, taught, held_out), several in sorted(groups.items(), key=lambda item: item[0], reverse=True):
        seeds = len({each.seed for each in several})
        title = f"{speed:g} m/s, {seeds} seed{'s' if seeds > 1 else ''} ({HELD_OUT if held_out else CHOSEN})"
        title += f", teacher of {taught:g} m/s" if taught != speed else ""
        title += f", again on {on}" if on else ""
        title += ", short budget" if any(each.short for each in several) else ""
        table[title] = [mean_and_range(several, name, decimals) for name, (_, decimals) in README_ROWS.items()]
    return pd.DataFrame(table)


def mean_and_range(jobs: Sequence[JobResult], name: str, decimals: int) -> str:
    """The mean of a number over jobs, and in brackets its smallest and largest value."""
    values = pd.Series([each.numbers.get(name) for each in jobs], dtype=float)
    mean, low, high = (fixed(float(value), decimals) for value in (values.mean(), values.min(), values.max()))
    return f"{mean} ({low} to {high})" if values.count() > 1 else mean
