"""Finished evaluations with everything that they were made from, found by the digests in their manifests."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from romgrl.artifacts import Manifest, read_manifest
from romgrl.config.addresses import keeps_numbers
from romgrl.config.schema import Config
from romgrl.config.values import as_before, show
from romgrl.errors import ArtifactError
from romgrl.gait.null_models import OVER_VARIANCE
from romgrl.provenance.stage_graph import STAGES, upstream_of
from romgrl.provenance.stage_keys import stage_settings
from romgrl.report.grid_tables import is_grid
from romgrl.report.terminal_tables import number, read_rows, result_metrics, with_falls, with_weakest
from romgrl.results.kept import open_numbers, order_made

LINEAGE = tuple(stage for stage in STAGES if stage in upstream_of("evaluation") | {"evaluation"})
TRACED = (LINEAGE[0], "library", *LINEAGE[1:])
"""With what a student that follows commands is made from; what reads another stage comes after it."""
SHOWN_DIFFERENCES = 3
CADENCE_OFF = "stride_frequency_deviation_percent"  # from the teacher's
TOUCHDOWNS = "touchdown_asymmetry_strides"
TRAINING_STEPS = "student/training_steps"
EVEN_TOUCHDOWNS = 0.5  # strides from a touchdown of one foot to that of the other
TEACHER = "trained_teacher"  # the check that ends its training; `teacher` is what the reference has of it

Catalogue = dict[str, dict[str, list[Manifest]]]  # stage -> digest -> manifests of artifacts with that content
Settings = dict[str, Any]


@dataclass(frozen=True)
class FinishedEvaluation:
    """A verified evaluation. `lineage`: the manifests of each stage that it may come from.

    There are several where settings or code differ and yet every bit is the same.
    """

    directory: Path
    manifest: Manifest
    lineage: dict[str, list[Manifest]]
    numbers: dict[str, float]

    @property
    def settings(self) -> Settings:
        """The settings of all stages together."""
        return {key: value for stage in self.lineage.values() for key, value in stage[0].config.items()}

    @property
    def finished_at(self) -> float:
        """When it was published, in seconds since 1970."""
        return (self.directory / "manifest.json").stat().st_mtime


def evaluations(outputs: Path) -> tuple[list[FinishedEvaluation], dict[Path, str]]:
    """Every evaluation under `outputs` that is whole, oldest first, and why others are not."""
    known, found, left_out = catalogue(outputs), [], {}
    for path in sorted(outputs.glob("artifacts/evaluation/*/manifest.json")):
        try:
            found.append(read_evaluation(path.parent, known))
        except ArtifactError as error:
            left_out[path.parent] = str(error).partition(": ")[2] or str(error)
    recorded = order_made(outputs, "evaluation") if keeps_numbers(outputs) else {}

    def age(each: FinishedEvaluation) -> tuple[float, str]:
        name = each.directory.name
        return recorded.get(name, len(recorded)) if recorded else each.finished_at, name

    return sorted(found, key=age), left_out


def read_evaluation(directory: Path, known: Catalogue) -> FinishedEvaluation:
    """Verify an evaluation and read its numbers. Raises ArtifactError."""
    manifest = open_numbers(directory, stage="evaluation")
    if is_grid(directory):
        raise ArtifactError(f"{directory}: of a student that follows commands")
    numbers, lineage = result_metrics(directory), trace(manifest, known)
    for stage, manifests in lineage.items():
        if not manifests:
            raise ArtifactError(f"{directory}: its {stage} is not there any more")
    outputs = directory.parents[2]
    for teacher in lineage.get("teacher", [])[:1]:
        place = artifact_place(outputs, teacher)
        open_numbers(place, stage="teacher")
        own = result_metrics(place)
        numbers |= {
            f"{TEACHER}/{name.partition('/')[2]}": value for name, value in own.items() if name.startswith("teacher/")
        }
    for student in lineage.get("student", [])[:1]:
        place = artifact_place(outputs, student)
        open_numbers(place, stage="student")
        numbers |= steps_made(place)
    numbers |= errors_by_channel(directory)
    return FinishedEvaluation(directory, manifest, lineage, with_weakest(with_falls(numbers)) | derived(numbers))


def steps_made(student: Path) -> dict[str, float]:
    """How many steps a training made, which may be more than its budget (`student.second_try`)."""
    curve = student / "curve.csv"
    rows = read_rows(curve) if curve.is_file() else []
    return {TRAINING_STEPS: number(rows[-1]["step"])} if rows else {}


def errors_by_channel(evaluation: Path) -> dict[str, float]:
    """The errors over variance of all walkers, as error_over_variance/pelvis_y/student."""
    rows = (row for row in read_rows(evaluation / "null_models.csv") if row["measure"] == OVER_VARIANCE)
    found = {f"{OVER_VARIANCE}/{row['channel']}/{row['walker']}": number(row["value"]) for row in rows}
    return {name: value for name, value in found.items() if math.isfinite(value)}


def derived(numbers: Mapping[str, float]) -> dict[str, float]:
    """How far cadences of student and baseline are from the teacher's, and how unevenly walkers set down their feet."""
    found = {}
    teacher = numbers.get("teacher/stride_frequency_hz", math.nan)
    for walker in ("student", "baseline"):
        cadence = numbers.get(f"{walker}/stride_frequency_hz", math.nan)
        if math.isfinite(cadence) and teacher > 0:
            found[f"{walker}/{CADENCE_OFF}"] = 100.0 * abs(cadence / teacher - 1.0)
    for name, phase in numbers.items():
        walker, _, measure = name.partition("/")
        if measure == "touchdown_phase_strides":
            found[f"{walker}/{TOUCHDOWNS}"] = abs(phase - EVEN_TOUCHDOWNS)
    return found


def catalogue(outputs: Path) -> Catalogue:
    """The manifests under `outputs`; those that cannot be read are left out."""
    known: Catalogue = {stage: {} for stage in TRACED}
    for stage in TRACED:
        for path in sorted(outputs.glob(f"artifacts/{stage}/*/manifest.json")):
            try:
                manifest = manifest_of(path.parent)
            except ArtifactError:
                continue
            known[stage].setdefault(manifest.digest, []).append(manifest)
    return known


def trace(manifest: Manifest, known: Catalogue) -> dict[str, list[Manifest]]:
    """The manifests of every stage that an artifact may come from, its own included."""
    lineage: dict[str, list[Manifest]] = {manifest.stage: [manifest]}
    for stage in reversed(TRACED):
        for child in lineage.get(stage, []):
            for name, digest in child.inputs.items():
                several = lineage.setdefault(name, [])
                several += [each for each in known.get(name, {}).get(digest, []) if each not in several]
    return lineage


def manifest_of(directory: Path) -> Manifest:
    """The manifest in a directory ROOT/artifacts/STAGE/KEY. Raises ArtifactError for that of another artifact."""
    manifest = read_manifest(directory)
    if manifest.stage != directory.parent.name or directory.name not in (manifest.key, other_name(manifest)):
        raise ArtifactError(f"{directory}: holds {manifest.stage}/{manifest.key}")
    return manifest


def other_name(manifest: Manifest) -> str:
    """What an artifact is called where another one has its key: of the same settings with other bits."""
    return f"{manifest.key}-{manifest.digest[:8]}"


def artifact_place(outputs: Path, manifest: Manifest) -> Path:
    """Where the artifact of a manifest of `catalogue` is."""
    place = outputs / "artifacts" / manifest.stage / manifest.key
    other = place.with_name(other_name(manifest))
    return other if other.is_dir() else place


def differences(evaluation: FinishedEvaluation, config: Config) -> list[str]:
    """In what an evaluation differs from a configuration with its seed, such as `eta 0.3 instead of 0.5`."""
    found: dict[str, str] = {}
    for stage in LINEAGE:
        wanted = simplified(stage_settings(stage, config)) | {"seed": evaluation.manifest.seed}
        candidates = [dict(differing(simplified(each.config), wanted)) for each in evaluation.lineage.get(stage, [])]
        if not candidates:
            found[stage] = f"its {stage} is not there any more"
        else:
            found = min(candidates, key=len) | found
    return list(found.values())


def differing(had: Settings, wanted: Settings) -> Iterator[tuple[str, str]]:
    """Yield each key in which settings differ, and in which way."""
    for key in sorted(had.keys() | wanted.keys()):
        if key not in had:
            if not as_before(key, wanted[key]):
                yield key, f"made before {key} was a key"
        elif key not in wanted:
            yield key, f"{key} {show(had[key])}, which is no key any more"
        elif had[key] != wanted[key]:
            yield key, f"{key} {show(had[key])} instead of {show(wanted[key])}"


def simplified(settings: Mapping[str, Any]) -> Settings:
    """Settings as a manifest reads them back."""
    return dict(json.loads(json.dumps(settings)))


def first_reasons(reasons: list[str]) -> str:
    """The first reasons, and how many more there are."""
    more = len(reasons) - SHOWN_DIFFERENCES
    return ", ".join(reasons[:SHOWN_DIFFERENCES]) + (f" and {more} more" if more > 0 else "")


@dataclass(frozen=True)
class Selection:
    """The evaluations of one configuration, one per seed, and why the others of the directory are not among them."""

    used: list[FinishedEvaluation]
    left_out: dict[Path, str]

    @property
    def seeds(self) -> list[int]:
        """The seeds, ascending."""
        return [each.manifest.seed for each in self.used]


def codes(evaluations: Sequence[FinishedEvaluation]) -> int:
    """By how many versions of code and libraries evaluations were made."""
    return len({(each.manifest.revision, json.dumps(each.manifest.versions, sort_keys=True)) for each in evaluations})


def other_bits(one: FinishedEvaluation, other: FinishedEvaluation) -> bool:
    """Tell whether two evaluations of the same settings are of the same committed code, and so differ in bits alone."""
    dirty = one.manifest.dirty or other.manifest.dirty
    return codes([one, other]) == 1 and one.manifest.revision is not None and not dirty


def select(outputs: Path, config: Config) -> Selection:
    """The evaluations whose settings are those of a configuration but for the seed; of two of a seed, the newer one.

    Where one and the same code made both, on processors whose bits differ, the first counts: nobody chose it.
    """
    found, left_out = evaluations(outputs)
    by_seed: dict[int, FinishedEvaluation] = {}
    for evaluation in found:
        reasons = differences(evaluation, config)
        seed = evaluation.manifest.seed
        if reasons:
            left_out[evaluation.directory] = first_reasons(reasons)
            continue
        if seed in by_seed and other_bits(evaluation, by_seed[seed]):
            left_out[evaluation.directory] = f"other bits of seed {seed}, of the same code; what was made first counts"
            continue
        if seed in by_seed:
            left_out[by_seed[seed].directory] = f"there is a newer one of seed {seed}, made by other code"
        by_seed[seed] = evaluation
    return Selection([by_seed[seed] for seed in sorted(by_seed)], left_out)
