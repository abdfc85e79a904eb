"""python -m romgrl.pretrained: ship the walkers of the newest evaluation that fits `student=pretrained`.

With student=pretrained_conditioned among the settings: the newest student that follows commands.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from romgrl.artifacts import MANIFEST, Manifest, open_artifact, storage_faults, sync_path, write_bytes
from romgrl.cli.arguments import checked, refuse
from romgrl.cli.compose import COMPOSITION_ERRORS, compose_config
from romgrl.cli.exit_codes import exit_code_of
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, ConfigurationError, RomgrlError
from romgrl.provenance import shipped
from romgrl.provenance.stage_keys import stage_settings
from romgrl.results.evaluation_index import (
    LINEAGE,
    FinishedEvaluation,
    differing,
    evaluations,
    first_reasons,
    simplified,
)
from romgrl.runtime.display import protect
from romgrl.runtime.surroundings import adapt_environment

CARD = "MODEL_CARD.md"
TRAINED = ("student=pretrained", "student.pretrained=false", "teacher.pretrained=false")
"""The training of what the preset takes from the package."""
CONDITIONED_PRESET = "student=pretrained_conditioned"
TRAINED_CONDITIONED = ("student.pretrained=false", "stage=student")


def find_evaluation(outputs: Path, config: Config) -> tuple[FinishedEvaluation, dict[str, Manifest]]:
    """The newest evaluation of a configuration, and what was trained for it.

    Raises ArtifactError with why others are not it.
    """
    found, left_out = evaluations(outputs)
    for evaluation in reversed(found):
        manifests, reasons = {}, list[str]()
        for stage in LINEAGE:
            candidates = [(unlike(stage, each, config), each) for each in evaluation.lineage.get(stage, [])]
            differing, nearest = min(candidates, key=lambda one: len(one[0]), default=([f"no {stage}"], None))
            reasons += differing
            if nearest is not None and stage in shipped.GROUPS:
                manifests[stage] = nearest
        if not reasons:
            return evaluation, manifests
        left_out[evaluation.directory] = first_reasons([*dict.fromkeys(reasons)])
    others = [f"{path.name}: {reason}" for path, reason in left_out.items()]
    raise ArtifactError("\n".join([f"{outputs}: no evaluation with the settings of student=pretrained", *others]))


def unlike(stage: str, manifest: Manifest, config: Config) -> list[str]:
    """In what an artifact differs from a configuration, such as `eta 0.3 instead of 0.5`; keys that came later do not
    count, as they do not in `shipped.other_settings`."""
    wanted = simplified(stage_settings(stage, config))
    return [text for key, text in differing(manifest.config, wanted) if key in wanted and key in manifest.config]


def ship(outputs: Path, config: Config) -> list[Path]:
    """Write the three artifacts, without what is about one machine or store, and the card; returns what was written."""
    from romgrl.pretrained.card import write_card  # imports Matplotlib, after `adapt_environment`

    evaluation, manifests = find_evaluation(outputs, config)
    sources = {stage: outputs / "artifacts" / stage / manifest.key for stage, manifest in manifests.items()}
    for stage, source in sources.items():
        open_artifact(source, stage=stage, key=source.name)
    text = write_card(evaluation, manifests)
    with new_place() as fresh:
        written = [
            path for stage in manifests for path in write_artifact(fresh / stage, manifests[stage], sources[stage])
        ]
        write_bytes(fresh / CARD, text.encode())
        swap(fresh, [*manifests, CARD])
    return [shipped.PLACE / path.relative_to(fresh) for path in [*written, fresh / CARD]]


@contextmanager
def new_place() -> Iterator[Path]:
    """A directory beside what ships, until what is written there takes its place or fails."""
    with storage_faults(shipped.PLACE):
        shipped.PLACE.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=".new-", dir=shipped.PLACE))
        try:
            yield fresh
        finally:
            shutil.rmtree(fresh, ignore_errors=True)


def ship_conditioned(outputs: Path, config: Config) -> list[Path]:
    """Write the artifacts of a student that follows commands and their card into a directory of their own."""
    from romgrl.pretrained.conditioned import find_conditioned, write_conditioned

    found = find_conditioned(outputs, config)
    with new_place() as fresh:
        target = fresh / shipped.CONDITIONED_PLACE
        target.mkdir()
        write_conditioned(target, found, config, write_artifact)
        written = sorted(path for path in target.rglob("*") if path.is_file())
        swap(fresh, [shipped.CONDITIONED_PLACE])
    return [shipped.PLACE / path.relative_to(fresh) for path in written]


def write_artifact(target: Path, manifest: Manifest, source: Path) -> list[Path]:
    """Copy an artifact without what is about one machine or store to a place where there is nothing yet."""
    target.mkdir()
    for name in manifest.files:
        write_bytes(target / name, (source / name).read_bytes())
    write_bytes(target / MANIFEST, replace(manifest, run_id=None).text.encode())
    return [*(target / name for name in manifest.files), target / MANIFEST]


def swap(fresh: Path, names: Sequence[str]) -> None:
    """Put what was written in the place of what ships now, which is all there again where that fails."""
    old = fresh / "old"
    old.mkdir()
    try:
        for name in names:
            if (shipped.PLACE / name).exists():
                os.rename(shipped.PLACE / name, old / name)
            os.rename(fresh / name, shipped.PLACE / name)
    except BaseException:
        for name in names:
            if not (fresh / name).exists():
                os.rename(shipped.PLACE / name, fresh / name)
            if (old / name).exists():
                os.rename(old / name, shipped.PLACE / name)
        raise
    sync_path(shipped.PLACE)


def main(arguments: Sequence[str]) -> int:
    """Ship and say what was written; the exit code of the failure otherwise."""
    protect()
    adapt_environment()
    what = "Put teacher, student and baseline of the newest evaluation that fits into the package, with a model card."
    parser = ArgumentParser("python -m romgrl.pretrained", description=what)
    parser.add_argument("outputs", help="the directory of results, as in paths.outputs")
    parser.add_argument("settings", nargs="*", metavar="key=value", help="in the place of those of student=pretrained")
    chosen = parser.parse_args(arguments)
    if "=" in chosen.outputs:
        parser.error(f"{chosen.outputs}: the directory of results comes first")
    try:
        follows = CONDITIONED_PRESET in chosen.settings
        config = compose_config(*checked([*(TRAINED_CONDITIONED if follows else TRAINED), *chosen.settings]))
        outputs = Path(chosen.outputs).expanduser().resolve()
        if not outputs.is_dir():
            raise ArtifactError(f"{outputs}: no such directory")
        written = (ship_conditioned if follows else ship)(outputs, config)
    except (ConfigurationError, *COMPOSITION_ERRORS) as error:
        return refuse(error)
    except (RomgrlError, OSError) as error:
        return exit_code_of(error)
    for path in written:
        print(f"{path.relative_to(shipped.PLACE)}: {path.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
