"""Who may write where: asked before any work, and told with the owner and the way out."""

from __future__ import annotations

import errno
import os
import pwd
from pathlib import Path

from romgrl.errors import ConfigurationError, StorageError

OUTPUTS = "paths.outputs"


def may_write(path: Path) -> bool:
    """Tell whether this user may write to a file or a directory, or make it where it is not there."""
    place = nearest_existing(path)
    return os.access(place, os.W_OK | os.X_OK if place.is_dir() else os.W_OK)


def require_right(path: Path, why: str, *, key: str = OUTPUTS) -> None:
    """Raise ConfigurationError unless this user may write there; `key` names another place.

    StorageError on a file system that nobody may write to.
    """
    if may_write(path):
        return
    place = nearest_existing(path)
    elsewhere = f"{key}=DIR of your own goes elsewhere"
    if os.statvfs(place).f_flag & os.ST_RDONLY:
        raise StorageError(f"{place}: {why}; {elsewhere}: {os.strerror(errno.EROFS)}")
    owner, user = name_of(place.stat().st_uid), name_of(os.geteuid())
    raise ConfigurationError(
        f"{place}: {why}, and {user} may not write there; {elsewhere}, or ask the owner, {owner}, for write permission"
    )


def nearest_existing(path: Path) -> Path:
    """The path itself or, where it is not there, what would have to hold it."""
    return next(place for place in (path, *path.parents) if os.path.exists(place))


def name_of(uid: int) -> str:
    """The name of a user; the number of one that this machine does not know."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"user {uid}"


def lock_mode(directory: Path) -> int:
    """Permissions of a lock file: whoever may make files in the directory may hold it."""
    return directory.stat().st_mode & 0o666
