"""The teacher by CMA-ES whose cycles the episodes of another one begin in (`teacher.cycles`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from romgrl.artifacts import Manifest, open_artifact
from romgrl.config.teachers import COMMANDS

UNASKED = {"stiffness_share": 1.0, "apex": 0.0}
"""What a teacher that is older than a command was asked for."""
Range = tuple[float, float]


def cycle_manifest(path: str) -> Manifest:
    """The verified manifest of a teacher. Raises ArtifactError, StorageError, or OSError for what is no path."""
    return open_artifact(Path(path), stage="teacher")


def cycle_identity(path: str) -> str:
    """Which teacher it is, wherever it lies: its key and its contents."""
    manifest = cycle_manifest(path)
    return f"{manifest.key} sha256:{manifest.digest}"


def learned_ranges(settings: Mapping[str, Any]) -> list[Range]:
    """Lowest and highest of each of COMMANDS that the training of a teacher asks for: m/s, share of the stiffness, m.

    settings: by dotted key, as a manifest has them; what is older than a key has none of it.
    """
    found = []
    for one, many in COMMANDS.items():
        low, high = settings.get(f"teacher.{many}") or 2 * [settings.get(f"teacher.{one}", UNASKED.get(one))]
        found.append((float(low), float(high)))
    return found


def shared_ranges(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[Range]:
    """What both of two teachers learn of each of COMMANDS; the lowest is above the highest where that is nothing."""
    pairs = zip(learned_ranges(one), learned_ranges(other), strict=True)
    return [(max(a[0], b[0]), min(a[1], b[1])) for a, b in pairs]
