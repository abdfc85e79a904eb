"""The model card of the walkers that ship: no number in it was typed, all come from manifests and the evaluation."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from romgrl.artifacts import Manifest
from romgrl.config.values import show
from romgrl.report.tables import distance_table, error_table, gait_table, markdown, null_models_table
from romgrl.results.evaluation_index import FinishedEvaluation
from romgrl.runtime.stage_log import format_duration

SCORED_BY = ("mse", "gait", "distances", "null_models")
CARD_TEXT = """# Model card: the pretrained teacher, student and baseline of romgrl

Written by `python -m romgrl.pretrained` from the manifests of the artifacts and the tables of their evaluation.

## What it is

Three policies as safetensors, each in the artifact that its training made:

- `teacher`: PPO on the reduced-order model, at {teacher_speed} m/s;
- `student`: SAC on the planar MuJoCo humanoid of {height} m and {mass} kg, at {speed} m/s, with a discriminator that \
compares its gait with the teacher's (eta {eta}, noise {noise});
- `baseline`: the same SAC with the speed reward alone.

`python -m romgrl student=pretrained` runs them. No motion capture and no data set of motions went into \
the trainings. Published statistics of people did: the body has its sizes, masses and strength from tables, and the \
reduced-order model was tuned until its gait lay in the human bands of docs/method.md or close to them.

## How it was trained

{trainings}
{versions}

{settings}
## What it scores

{episodes} deterministic episodes of {steps} control steps for each policy, from the same states, which no \
training has drawn; the last {window} steps count.

{errors}
{gaits}
{distances}
Beside walkers that learned nothing (docs/method.md says what they are):

{nulls}
## Limits

- One training each (seed {seed}): other seeds give other gaits; README.md has a table of some. Seeds 0 to 4 were \
looked at while body, teacher, learner and discriminator were chosen, so no number above is of a held-out seed.
- For the settings above alone: {speed} m/s, this body, this actuation, flat ground. The student was trained with no \
disturbance; `python -m romgrl stage=robustness student=pretrained` measures what it takes.
- Held in the sagittal plane, in simulation. Not made for a robot, and no evidence about human gait or health.

## Licence

MIT, as all of romgrl.
"""


def write_card(evaluation: FinishedEvaluation, manifests: Mapping[str, Manifest]) -> str:
    """The card in Markdown."""
    student, scored = manifests["student"].config, evaluation.manifest.config
    tables = {name: pd.read_csv(evaluation.directory / f"{name}.csv") for name in SCORED_BY}
    return CARD_TEXT.format(
        speed=show(student["speed"]),
        teacher_speed=show(student["teacher.speed"]),
        height=show(student["humanoid.height"]),
        mass=show(student["humanoid.mass"]),
        eta=show(student["eta"]),
        noise=show(student["noise"]),
        seed=evaluation.manifest.seed,
        trainings=markdown(trainings(manifests)),
        versions=card_versions(manifests),
        settings=markdown(training_settings(manifests)),
        episodes=scored["evaluation.episodes"],
        steps=scored["evaluation.steps"],
        window=scored["evaluation.window"],
        errors=markdown(error_table(tables["mse"])),
        gaits=markdown(gait_table(tables["gait"])),
        distances=markdown(distance_table(tables["distances"])),
        nulls=markdown(null_models_table(tables["null_models"])),
    )


def trainings(manifests: Mapping[str, Manifest]) -> pd.DataFrame:
    """One row for each training."""
    rows = []
    for stage, manifest in manifests.items():
        steps = manifest.config["teacher.total_steps" if stage == "teacher" else "student.total_steps"]
        revision = f"{manifest.revision or 'unknown'}{' and changes to it' if manifest.dirty else ''}"
        time, threads = format_duration(manifest.wall_time), str(manifest.threads)
        row = {"": stage, "steps": steps, "seed": manifest.seed, "time": time, "threads": threads}
        rows.append(row | {"revision": revision, "content": f"sha256 {manifest.digest}"})
    return pd.DataFrame(rows)


def card_versions(manifests: Mapping[str, Manifest]) -> str:
    """With which libraries, in one line for each set of them."""
    lines = [
        f"{', '.join(f'{name} {version}' for name, version in sorted(each.versions.items()))}"
        for each in manifests.values()
    ]
    return "\n".join(f"Made with {line}." for line in dict.fromkeys(lines))


def training_settings(manifests: Mapping[str, Manifest]) -> pd.DataFrame:
    """Every setting of a training, by key, with a column for each of the three."""
    keys = sorted({key for manifest in manifests.values() for key in manifest.config})
    return pd.DataFrame(
        [
            {"setting": f"`{key}`"}
            | {stage: show(each.config[key]) if key in each.config else "-" for stage, each in manifests.items()}
            for key in keys
        ]
    )
