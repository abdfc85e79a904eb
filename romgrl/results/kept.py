"""A directory that keeps the numbers of sweeps (`romgrl.results.keep`): what it has, and how to read it."""

from __future__ import annotations

from pathlib import Path

from romgrl.artifacts import Manifest, open_artifact
from romgrl.config.addresses import keeps_numbers
from romgrl.results.sweep_record import sweeps

KEPT_TEXT = """Numbers of sweeps: of each job the manifests of its artifacts and their tables, without policies
and rollouts. Written by `python -m romgrl.results.keep OUTPUTS DIRECTORY`; `python -m romgrl.results DIRECTORY docs`
writes documents from it, as from the directory of results. Every table has the SHA-256 that its manifest says.
"""
KEPT_TABLES: dict[str, tuple[str, ...]] = {
    "teacher": ("gait.csv",),
    "reference": (),
    "library": ("library.csv",),
    "student": ("curve.csv",),
    "baseline": (),
    "evaluation": ("*.csv", "grid.json"),
    "robustness": ("*.csv",),
}  # what is read of each stage besides its manifest, as patterns


def open_numbers(directory: Path, *, stage: str) -> Manifest:
    """Verify an artifact, or as much of it as is kept. Raises ArtifactError.

    directory: ROOT/artifacts/STAGE/KEY, where `keeps_numbers(ROOT)` says that files may be missing but for KEPT_TABLES.
    """
    if not keeps_numbers(directory.parents[2]):
        return open_artifact(directory, stage=stage)
    return open_artifact(directory, stage=stage, needed=KEPT_TABLES[stage])


def order_made(root: Path, stage: str) -> dict[str, int]:
    """The directories of a stage's artifacts in the order in which the records of sweeps say that they were made.

    Times of kept files say when they were copied.
    """
    paths = [Path(end.artifacts[stage]).name for sweep in sweeps(root) for end in sweep.ends if stage in end.artifacts]
    return {name: place for place, name in enumerate(dict.fromkeys(paths))}
