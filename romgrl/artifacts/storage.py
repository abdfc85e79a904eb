"""Writing that survives: what is here is on the disk when a function returns, or a StorageError says why not."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

from romgrl.errors import StorageError

FAULTS = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOTEMPTY}
)


@contextmanager
def storage_faults(place: Path) -> Iterator[None]:
    """Turn what a disk refuses while the block runs into a StorageError, which names the file, or else `place`."""
    try:
        yield
    except OSError as error:
        if error.errno not in FAULTS:
            raise
        raise StorageError(f"{error.filename or place}: {os.strerror(error.errno)}") from error


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all. Raises StorageError."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with storage_faults(path):
        try:
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        finally:
            with suppress(OSError):  # the first fault is the one to tell
                temporary.unlink(missing_ok=True)


def sync_path(path: Path) -> None:
    """Put a file, or the names in a directory, on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def tree(directory: Path) -> list[Path]:
    """Everything under a directory, sorted. Raises OSError for what cannot be read, which `rglob` would skip."""

    def fail(error: OSError) -> NoReturn:
        raise error

    walk = os.walk(directory, onerror=fail)
    return sorted(Path(root, name) for root, directories, files in walk for name in (*directories, *files))


def sync_tree(directory: Path) -> None:
    """Put every file and every name under a directory on the disk."""
    for path in reversed(tree(directory)):  # what a directory holds before the directory
        if path.is_dir() or path.is_file():
            sync_path(path)
    sync_path(directory)
