"""How an artifact gets its name, and how a damaged one loses it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from romgrl.artifacts.manifest import read_manifest
from romgrl.artifacts.rights import require_right
from romgrl.artifacts.storage import storage_faults, sync_path, sync_tree
from romgrl.errors import ArtifactError, StorageError


def publish(partial: Path, directory: Path) -> None:
    """Rename a directory with its manifest to `directory`, once all of it is on the disk.

    Raises StorageError; then `directory` is not there and `partial` is as it was, or, where only the last step failed,
    the whole of it is there. Raises ArtifactError where the manifest is missing.
    """
    read_manifest(partial)
    with storage_faults(partial):
        sync_tree(partial)
        os.rename(partial, directory)
        sync_path(directory.parent)


def set_aside(directory: Path) -> Path:
    """Rename a damaged artifact to `<key>.damaged-<UTC time>`, so that its place is free; returns where it is now."""
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%fZ")
    aside = directory.with_name(f"{directory.name}.damaged-{now}")
    with storage_faults(directory):
        os.rename(directory, aside)
        sync_path(directory.parent)
    return aside


@contextmanager
def setting_aside(directory: Path) -> Iterator[None]:
    """An artifact that is found damaged while the block runs is set aside, and the ArtifactError says where it is.

    Raises ConfigurationError where this user may not do that.
    """
    try:
        yield
    except ArtifactError as error:
        require_right(directory.parent, f"{error}; it is to be set aside")
        try:
            place = f"set aside as {set_aside(directory).name}"
        except FileNotFoundError:
            place = "set aside by another process"
        except StorageError as fault:
            raise ArtifactError(f"{error}; it cannot be set aside: {fault}") from error
        raise ArtifactError(f"{error}; {place}; the same command makes it anew") from error
