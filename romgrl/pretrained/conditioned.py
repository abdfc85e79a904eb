"""What ships of a student that follows commands: it, the cells that taught it, their teacher, and a card.

The library is cut to the cells that can teach, fit ones on legs of the usual stiffness: the others are most of it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from romgrl.artifacts import Manifest, open_artifact, save_arrays, write_bytes, write_manifest
from romgrl.config.commanded import CONDITIONED
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.pretrained.card import card_versions, training_settings
from romgrl.provenance.kept_check import kept_check, worst_fifth
from romgrl.provenance.shipped import CONDITIONED_STAGES
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import stage_settings
from romgrl.provenance.taught_cells import can_teach
from romgrl.report.finished_library import RECORDED, read_library
from romgrl.report.tables import markdown
from romgrl.results.evaluation_index import differing, first_reasons, manifest_of, simplified
from romgrl.runtime.stage_log import format_duration

CONDITIONED_CARD = "MODEL_CARD.md"
LARGEST_SHIPPED = 3_000_000
"""Bytes of all that ships of it."""
NOT_COMPARED = ("library.others", "student.pretrained")
COMMANDED_CARD_TEXT = """# Model card: the pretrained student of romgrl that follows commands

Written by `python -m romgrl.pretrained` from the manifests of the artifacts and the tables beside them.

## What it is

- `student`: SAC on the planar MuJoCo humanoid, asked for a speed and a gait while it runs: {ranges};
- `library`: the {cells} cells that can teach it, of the library with content sha256 {library};
- `teacher`: of that library.{baseline}

`python -m romgrl student=pretrained_conditioned stage=watch speed={speed}` shows it.

## How it was trained

{trainings}
{versions}

{settings}
## What it scores

{scores}
## Limits

- One training (seed {seed}). Commands are those above: one gait at a time, held for seconds, one stiffness of the legs.
- Held in the sagittal plane, in simulation, on flat ground, for the body and the actuation of its settings. Not made \
for a robot, and no evidence about human gait or health.

## Licence

MIT, as all of romgrl.
"""


class Found(NamedTuple):
    """An artifact, and where it is."""

    place: Path
    manifest: Manifest


def artifacts_of(outputs: Path, stage: str) -> list[Found]:
    """The artifacts of a stage under `outputs`, the newest first; those that cannot be read are left out."""
    found = []
    for path in outputs.glob(f"artifacts/{stage}/*/manifest.json"):
        try:
            found.append((path.stat().st_mtime, path.parent, manifest_of(path.parent)))
        except ArtifactError:
            continue
    return [Found(place, manifest) for _, place, manifest in sorted(found, key=lambda each: each[:2], reverse=True)]


def find_conditioned(outputs: Path, config: Config) -> dict[str, Found]:
    """The newest student of a configuration, the library and the teacher behind it; its evaluation and a baseline of
    the same settings where there are any. Raises ArtifactError with why others are not it."""
    left_out = [f"{outputs}: no student with the settings of student=pretrained_conditioned"]
    for student in artifacts_of(outputs, "student"):
        reasons = unlike_conditioned("student", student.manifest, config)
        library = made_of(outputs, "library", student.manifest)
        teacher = None if library is None else made_of(outputs, "teacher", library.manifest)
        if not reasons and library is not None and teacher is not None:
            found = {"teacher": teacher, "library": library, "student": student}
            baselines = [
                each
                for each in artifacts_of(outputs, "baseline")
                if each.manifest.inputs.get("library") == library.manifest.digest
                and not unlike_conditioned("baseline", each.manifest, config)
            ]
            scored = [
                each
                for each in artifacts_of(outputs, "evaluation")
                if each.manifest.inputs.get("student") == student.manifest.digest
            ]
            found |= {"baseline": baselines[0]} if baselines else {}
            return found | ({"evaluation": scored[0]} if scored else {})
        missing = "its library or the teacher of that is not there any more"
        left_out.append(f"{student.place.name}: {first_reasons(reasons) if reasons else missing}")
    raise ArtifactError("; ".join(left_out))


def made_of(outputs: Path, stage: str, manifest: Manifest) -> Found | None:
    """The artifact of a stage that another one was made from."""
    same = [each for each in artifacts_of(outputs, stage) if each.manifest.digest == manifest.inputs.get(stage)]
    return same[0] if same else None


def unlike_conditioned(stage: str, manifest: Manifest, config: Config) -> list[str]:
    """In what an artifact differs from a configuration; keys that came later do not count."""
    if manifest.config.get("student.kind") != CONDITIONED:
        return ["of one speed"]
    wanted = simplified(stage_settings(stage, config))
    compared = (wanted.keys() & manifest.config.keys()) - {*NOT_COMPARED}
    return [text for key, text in differing(manifest.config, wanted) if key in compared]


def write_conditioned(
    target: Path, found: dict[str, Found], config: Config, write: Callable[[Path, Manifest, Path], list[Path]]
) -> None:
    """Write the artifacts, verified, and the card. Raises ArtifactError for more than LARGEST_SHIPPED."""
    for stage, each in found.items():
        open_artifact(each.place, stage=stage, key=each.place.name)
        if stage == "library":
            write_cut_library(target / stage, each, config)
        elif stage in (*CONDITIONED_STAGES, "baseline"):
            write(target / stage, each.manifest, each.place)
    write_bytes(target / CONDITIONED_CARD, conditioned_card(target, found).encode())
    size = sum(path.stat().st_size for path in target.rglob("*") if path.is_file())
    if size > LARGEST_SHIPPED:
        raise ArtifactError(f"{found['student'].place}: {size} bytes would ship; at most {LARGEST_SHIPPED} may")


def write_cut_library(target: Path, library: Found, config: Config) -> None:
    """The cells that can teach, as a library that names the one that it was cut from among its inputs."""
    steps, manifest = config.reference.steps, library.manifest
    whole = read_library(library.place, steps=steps, dt=1.0 / config.humanoid.control_frequency)
    table = whole.table
    rows = table.index[can_teach(table)]
    arrays = {name: values[rows] if name in RECORDED else values for name, values in whole.arrays.items()}
    target.mkdir()
    table.loc[rows].to_csv(target / "library.csv", index=False)
    save_arrays(target / "library.npz", arrays)
    write_manifest(
        target,
        stage="library",
        key=manifest.key,
        config=manifest.config,
        inputs={**manifest.inputs, "library": manifest.digest},
        versions=manifest.versions,
        revision=manifest.revision,
        dirty=manifest.dirty,
        seed=manifest.seed,
        wall_time=manifest.wall_time,
        threads=manifest.threads,
    )


def conditioned_card(target: Path, found: dict[str, Found]) -> str:
    """The card in Markdown: no number in it was typed."""
    manifests = {stage: each.manifest for stage, each in found.items() if stage != "evaluation"}
    cells = pd.read_csv(target / "library" / "library.csv")
    ends = cells.groupby("gait").speed_m_per_s.agg(["min", "max"])
    ranges = [f"{gait} {low:g} to {high:g} m/s" for gait, low, high in ends.itertuples()]
    rows = [
        {
            "": stage,
            "steps": str(each.config.get(f"{stage if stage == 'teacher' else 'student'}.total_steps", "-")),
            "seed": each.seed,
            "time": format_duration(each.wall_time),
            "revision": f"{each.revision or 'unknown'}{' and changes to it' if each.dirty else ''}",
            "content": f"sha256 {each.digest}",
        }
        for stage, each in manifests.items()
    ]
    settings = {stage: each for stage, each in manifests.items() if stage != "library"}
    return COMMANDED_CARD_TEXT.format(
        ranges=", ".join(ranges),
        cells=len(cells),
        library=manifests["library"].digest,
        baseline="\n- `baseline`: the same commands, without imitation." if "baseline" in found else "",
        speed=f"{float(ends['min'].iloc[0]):g}",
        trainings=markdown(pd.DataFrame(rows)),
        versions=card_versions(manifests),
        settings=markdown(training_settings(settings)),
        scores=scores(found),
        seed=manifests["student"].seed,
    )


def scores(found: dict[str, Found]) -> str:
    """The tables of the evaluation, or what the training saw when it chose its policy, where there is none."""
    if "evaluation" in found:
        place = found["evaluation"].place
        tables = [name for name in STAGES["evaluation"].tables if (place / name).is_file()]
        parts = [f"`{name}`:\n\n{markdown(pd.read_csv(place / name))}" for name in tables]
        return "\n".join(["Of the evaluation of this student:\n", *parts])
    path = found["student"].place / "checks.csv"
    if not path.is_file():
        return "Nothing: it was not evaluated, and not checked while it was trained (`student.check_steps=0`).\n"
    checks = pd.read_csv(path)
    scores_by_step = checks.groupby("step").shortfall.agg(lambda shortfalls: worst_fifth(shortfalls.tolist()))
    kept = kept_check(scores_by_step.tolist(), str(found["student"].manifest.config.get("student.kept_policy")))
    text = (
        "Not evaluated yet. What the training saw of the policy that it kept, by which it chose it: too good by that.\n"
    )
    return f"{text}\n{markdown(checks[checks.step == scores_by_step.index[kept]].drop(columns='step'))}"
