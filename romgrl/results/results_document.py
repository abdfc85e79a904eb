"""docs/results.md: every sweep with its commands, claims, tables, figures and proofs. Nothing is typed by hand."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pandas as pd

from romgrl.artifacts import storage_faults, write_bytes
from romgrl.errors import ArtifactError
from romgrl.report.tables import markdown
from romgrl.results.claim_sheets import claim_sheets
from romgrl.results.claims import claims_for, finding_of, read_claims
from romgrl.results.evaluation_index import FinishedEvaluation, catalogue, codes
from romgrl.results.seed_groups import by_group, seeds_told
from romgrl.results.sweep_cells import SEED_KEY, JobResult, by_cell, headline_jobs, note, results, seed_of
from romgrl.results.sweep_record import Sweep, public, settings, sweeps
from romgrl.results.sweep_tables import failures, walked, write_tables
from romgrl.results.verify import baseline_sheet, errors_sheet, plural, warnings
from romgrl.results.walker_sheets import gait_sheet, nulls_sheet

PAPER = "paper"
CLAIMED = (PAPER, "walking")  # the sweeps whose cells the claims are compared with
FILES = "files.txt"  # in results/: what was written there, which the next writing replaces
TRAININGS = ("teacher", "student", "baseline")
HEAD = """# Results

All of it is written by `python -m romgrl.results outputs docs` from the artifacts of sweeps; the numbers are in
`docs/results/` as CSV, too. Square brackets hold 95% bootstrap intervals over seeds, parentheses the smallest and
largest of fewer than five seeds, which are too few for a verdict; [method.md](method.md) says how to read them, and p.
Seeds 0 to 4 chose the settings; held-out seeds stand apart, and figures and claims are of them where there are any.
`one seed` and `short budget` (fewer training steps than the default) stand beside what that is true of,
`baseline falls` where there is no baseline to compare with. Where a target is missed, trials.md says
[what was tried](trials.md#what-decides-the-students-cadence).
"""


FinishedSweeps = list[tuple[Sweep, list[JobResult]]]
"""Sweeps, each with what its jobs came to."""


def finished_sweeps(outputs: Path) -> FinishedSweeps:
    """The sweeps under `outputs`, each with its jobs. Raises ArtifactError where there are none."""
    found = merged(sweeps(outputs))
    if not found:
        command = "python -m romgrl --config-dir sweeps --config-name paper"
        raise ArtifactError(f"{outputs}: holds no sweep; {command} makes one")
    known = catalogue(outputs)
    return [(sweep, results(sweep, outputs, known)) for sweep in found]


def write_document(found: FinishedSweeps, outputs: Path, docs: Path, others: Mapping[Path, str]) -> list[Path]:
    """Write results.md and results/ from finished sweeps under `outputs`, and the text of other files along with them.

    Nothing is replaced before all of it is written. Returns what is in `docs`. Raises ArtifactError and StorageError.
    """
    jobs = [each for _, several in found for each in several]
    if not any(each.numbers for each in jobs):
        first = next((each.error for each in jobs if each.error), "none has finished")
        raise ArtifactError(f"{outputs}: no job of its sweeps has numbers ({first}); nothing was replaced")
    directory = docs / "results"
    with storage_faults(docs):
        directory.mkdir(parents=True, exist_ok=True)
        with temporary_directory(directory) as fresh, temporary_files(others) as temporaries:
            text = [HEAD]
            for sweep, several in sorted(found, key=lambda each: (each[0].name != PAPER, each[0].title)):
                text += results_section(sweep, several, outputs, fresh)
            text += same_speeds(found)
            made = [path.name for path in fresh.iterdir()] + [FILES]
            (fresh / FILES).write_text("\n".join([*sorted(made), ""]), encoding="utf-8")
            before = made_before(directory)
            with temporary_files({docs / "results.md": "\n".join(text)}) as document:
                for name in made:
                    (fresh / name).replace(directory / name)
                for path, temporary in (document | temporaries).items():
                    temporary.replace(path)
        prefixes = tuple(prefix_of(sweep) for sweep, _ in found)
        for old in before - set(made):
            if old.startswith(prefixes):
                (directory / old).unlink(missing_ok=True)
    return [docs / "results.md", *sorted(directory.iterdir())]


def made_before(directory: Path) -> set[str]:
    """The files that the last writing left in a directory, by its list of them; none of anybody else's."""
    path = directory / FILES
    names = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return {name for name in names if Path(name).name == name}


@contextmanager
def temporary_directory(place: Path) -> Iterator[Path]:
    """A directory in another one, which is gone at the end."""
    fresh = Path(tempfile.mkdtemp(prefix=".new-", dir=place))
    try:
        yield fresh
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


@contextmanager
def temporary_files(texts: Mapping[Path, str]) -> Iterator[dict[Path, Path]]:
    """The texts in files beside those that they are to replace; what was not renamed is gone at the end."""
    temporaries = {path: path.with_name(f".{path.name}.new") for path in map(Path.resolve, texts)}
    try:
        for temporary, text in zip(temporaries.values(), texts.values(), strict=True):
            write_bytes(temporary, text.encode())
        yield temporaries
    finally:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)


def prefix_of(sweep: Sweep) -> str:
    """How the names of a sweep's files begin."""
    return f"{plain_name(sweep.title)}_"


def plain_name(text: str) -> str:
    """A text as a part of a file's name."""
    return re.sub(r"[^A-Za-z0-9_=-]+", "_", text.replace(",", "")).rstrip("_")


def merged(found: Sequence[Sweep]) -> list[Sweep]:
    """One sweep for each title and processor, whose bits differ: the jobs of all its runs, each as it ended last."""
    by_title: dict[tuple[str, str], Sweep] = {}
    first: dict[str, str] = {}
    for sweep in found:
        processor = str(sweep.machine.get("processor", ""))
        place = sweep.subject, processor
        known = by_title.get(place)
        if known is None:
            by_title[place] = replace(
                sweep, on="" if first.setdefault(sweep.subject, processor) == processor else processor
            )
            continue
        jobs = {tuple(sorted(settings(job).items())): job for job in [*known.jobs, *sweep.jobs]}
        command = "\n".join(dict.fromkeys([*known.command.splitlines(), sweep.command]))
        ends = [*known.ends, *sweep.ends]
        by_title[place] = replace(known, jobs=[*jobs.values()], command=command, ends=ends)
    return list(by_title.values())


def results_section(sweep: Sweep, jobs: list[JobResult], outputs: Path, directory: Path) -> list[str]:
    """A sweep: command, machine, claims where it is the paper's, joint table, figures, and the proof of each job."""
    prefix = prefix_of(sweep)
    table, paths = write_tables(sweep, jobs, outputs, directory / ".new")
    for path in paths:
        path.replace(directory / f"{prefix}{path.name}")
    shutil.rmtree(directory / ".new")
    text = [f"## {sweep.title}", "", *(f"    {public(line)}" for line in sweep.command.splitlines()), ""]
    text += [provenance(sweep, jobs), "", *table, *failures(jobs), ""]
    if sweep.name in CLAIMED:
        text += claims(jobs, directory, plain_name(sweep.on))
    for figure in sorted(directory.glob(f"{prefix}*.png")):
        text += [f"![{sweep.title}, {figure.stem.removeprefix(prefix)}](results/{figure.name})", ""]
    links = [f"[{path.name}](results/{prefix}{path.name})" for path in paths if path.suffix == ".csv"]
    return [*text, proofs(jobs), f"All numbers: {', '.join(links)}.", ""]


def same_speeds(found: FinishedSweeps) -> list[str]:
    """Students that are asked for the same speed: of sweeps over seeds and speeds alone."""
    rows: dict[float, list[dict[str, str]]] = {}
    for sweep, jobs in sorted(found, key=lambda each: each[0].title):
        for cell in by_cell(headline_jobs(jobs if set(sweep.swept) <= {SEED_KEY, "speed"} else [])):
            if (evaluation := cell[0].evaluation) is not None:
                speed, taught = (float(evaluation.settings[key]) for key in ("speed", "teacher.speed"))
                row = {"asked [m/s]": f"{speed:g}", "sweep": sweep.title, "its teacher runs at [m/s]": f"{taught:g}"}
                row["seeds"] = ", ".join(sorted(str(each.seed) for each in cell))
                rows.setdefault(speed, []).append(row | walked(cell) | {"note": note(cell)})
    shared = [row for _, several in sorted(rows.items()) if len(several) > 1 for row in several]
    if not shared:
        return []
    said = "Asked for one speed, sweep by sweep; their teachers and legs are those of its file in `sweeps/`"
    return [
        "## Students of the same speed",
        "",
        f"{said}; fewer than five seeds are no verdict:",
        "",
        markdown(pd.DataFrame(shared)),
    ]


def provenance(sweep: Sweep, jobs: Sequence[JobResult]) -> str:
    """How many jobs, on what, how long, with which versions."""
    evaluations = [each.evaluation for each in jobs if each.evaluation is not None]
    done = sum(each.error is None for each in jobs)
    made = {
        (several[0].digest, several[0].key, several[0].stage): several[0].wall_time
        for evaluation in evaluations
        for several in evaluation.lineage.values()
    }
    machine = sweep.machine
    text = f"{done} of {plural(len(jobs), 'job')} finished. Machine: {machine.get('processor', 'unknown')}, "
    text += f"{machine.get('cores_used', '?')} of {machine.get('cores', '?')} cores, {machine.get('system', '')}. "
    if made:
        text += (
            f"Their {plural(len(made), 'artifact')} took {sum(made.values()) / 60:.0f} minutes, one after the other. "
        )
        versions = evaluations[0].manifest.versions
        text += "Versions: " + ", ".join(f"{name} {number}" for name, number in sorted(versions.items())) + "."
        if codes(evaluations) > 1:
            text += f" {codes(evaluations)} versions of code or libraries made them."
    return text


def claims(jobs: Sequence[JobResult], directory: Path, on: str) -> list[str]:
    """The claims about each cell, its errors and the spread of its baseline; held-out seeds apart, and first."""
    text = []
    for cell in by_cell(each for each in jobs if each.evaluation is not None):
        groups = by_group(cell, seed_of)
        for place, (group, members) in enumerate(groups.items()):
            evaluations = [each.evaluation for each in members if each.evaluation is not None]
            of = evaluations[0].settings
            name = f"{of['speed']:g} m/s, teacher of {of['teacher.speed']:g} m/s"
            name += f", seeds that {group}" if place else ""
            tables = claim_tables(evaluations, directory, f"{'_chosen' if place else ''}{f'_{on}' if on else ''}")
            text += [f"### Claims at {name}", "", *notes_of(members), *tables]
    return text


def notes_of(cell: Sequence[JobResult]) -> list[str]:
    """What must stand beside the numbers of a cell."""
    seeds = seeds_told([each.seed for each in cell if each.seed is not None])
    lines = [f"{seeds[0].upper()}{seeds[1:]}."]
    if any(each.short for each in cell):
        lines.append("Short budget: " + "; ".join(dict.fromkeys(text for each in cell for text in each.short)) + ".")
    return [" ".join(lines), ""]


def claim_tables(evaluations: list[FinishedEvaluation], directory: Path, ending: str) -> list[str]:
    """Claims, errors, spread of the baseline and warnings; each table as CSV, too, its name with this ending."""
    of = evaluations[0].settings
    findings = [finding_of(claim, evaluations) for claim in claims_for(of, read_claims())]
    walkers = nulls_sheet(evaluations), gait_sheet(evaluations)
    sheets = [*claim_sheets(findings, evaluations), *walkers, errors_sheet(evaluations), baseline_sheet(evaluations)]
    text = []
    for sheet in sheets:
        if sheet.rows:
            name = f"{PAPER}_{sheet.file}_{of['speed']:g}_teacher_{of['teacher.speed']:g}{ending}.csv"
            pd.DataFrame(sheet.rows, columns=list(sheet.columns)).to_csv(directory / name, index=False)
            text += [f"{sheet.title}:", "", sheet.markdown()]
    return [*text, *(f"- {line}" for line in warnings(evaluations)), ""]


def proofs(jobs: Sequence[JobResult]) -> str:
    """A row per job: wall time of its stages, key and digest of its evaluation, and the code that made it."""
    rows = []
    for each in jobs:
        if each.evaluation is not None:
            manifest = each.evaluation.manifest
            minutes = {stage: several[0].wall_time / 60 for stage, several in each.evaluation.lineage.items()}
            row = each.swept | {f"{stage} [min]": f"{minutes[stage]:.1f}" for stage in TRAININGS if stage in minutes}
            code = (manifest.revision or "unknown")[:10] + (" with changes" if manifest.dirty else "")
            rows.append(row | {"evaluation": manifest.key, "digest": manifest.digest[:16], "code": code})
    return markdown(pd.DataFrame(rows)) if rows else ""
