"""python -m romgrl.pretrained: ship the walkers of the newest evaluation that fits `student=pretrained`."""

from __future__ import annotations

import shutil
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from romgrl.artifacts import MANIFEST, Manifest, open_artifact, write_bytes
from romgrl.cli.compose import COMPOSITION_ERRORS, compose_config, explanation
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


def trained(config: Config) -> Config:
    """The configuration that trains what the preset takes from the package."""
    teacher, student = replace(config.teacher, pretrained=False), replace(config.student, pretrained=False)
    return replace(config, teacher=teacher, student=student)


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
    card, text = shipped.PLACE / CARD, write_card(evaluation, manifests)  # it may fail: before anything is replaced
    written = [
        path for stage, manifest in manifests.items() for path in write_artifact(stage, manifest, sources[stage])
    ]
    write_bytes(card, text.encode())
    return [*written, card]


def write_artifact(stage: str, manifest: Manifest, source: Path) -> list[Path]:
    """Put one artifact in the place of the one that ships now."""
    target = shipped.PLACE / stage
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for name in manifest.files:
        write_bytes(target / name, (source / name).read_bytes())
    write_bytes(target / MANIFEST, replace(manifest, run_id=None).text.encode())
    return [*(target / name for name in manifest.files), target / MANIFEST]


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
        config = trained(compose_config("student=pretrained", *chosen.settings))
        written = ship(Path(chosen.outputs).expanduser().resolve(), config)
    except COMPOSITION_ERRORS as error:
        print(explanation(error), file=sys.stderr)
        return ConfigurationError.exit_code
    except RomgrlError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    for path in written:
        print(f"{path.relative_to(shipped.PLACE)}: {path.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
