"""The proof of an artifact: every file that its manifest lists, as the manifest says, and no other."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from pathlib import Path, PurePath

from romgrl.artifacts.manifest import MANIFEST, FileRecord, Manifest, payload, read_manifest, record_file
from romgrl.artifacts.storage import storage_faults
from romgrl.errors import ArtifactError


def open_artifact(
    directory: Path, *, stage: str | None = None, key: str | None = None, needed: Collection[str] = ("*",)
) -> Manifest:
    """Verify SHA-256, size, dtypes and shapes of every file. Raises ArtifactError naming the first bad file.

    `stage` and `key`: what it must have been made as; None: anything. `needed`: patterns of files that must be
    there.
    """
    manifest = read_manifest(directory)
    for name, made, expected in (("stage", manifest.stage, stage), ("key", manifest.key, key)):
        if expected is not None and made != expected:
            raise ArtifactError(f"{directory / MANIFEST}: made by {name} {made}, expected {expected}")
    with storage_faults(directory):
        found = set(payload(directory))
        for name, record in manifest.files.items():
            if name not in found:
                if not any(PurePath(name).match(pattern) for pattern in needed):
                    continue
                raise ArtifactError(f"{directory / name}: missing")
            check_file(directory / name, record)
    extra = sorted(found - set(manifest.files))
    if extra:
        raise ArtifactError(f"{directory / extra[0]}: not listed in the manifest")
    return manifest


def check_file(path: Path, record: FileRecord) -> None:
    """Raise ArtifactError unless a file is as its record says; its bytes come first, so that no others are parsed."""
    with path.open("rb") as file:
        if path.stat().st_size != record.size or hashlib.file_digest(file, "sha256").hexdigest() != record.sha256:
            raise ArtifactError(f"{path}: does not have the SHA-256 of its manifest; it was changed or damaged")
    if record_file(path) != record:
        raise ArtifactError(f"{path}: arrays do not have the shapes and dtypes of its manifest")
