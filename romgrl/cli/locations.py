"""Where results go: is the directory one that can be written, and the store one that MLflow can open?"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

from romgrl.config.addresses import KEPT_FILE, keeps_numbers, sqlite_path
from romgrl.config.schema import Config
from romgrl.config.values import refusal
from romgrl.tracking.journal import redacted

SERVERS = ("http", "https")
DATABASES = ("postgresql", "mysql", "mssql")
LONGEST_BELOW = 200  # characters of the longest path below the directory of the results
LONGEST_EXPERIMENT = 250  # characters that a database of MLflow's keeps


def outputs_directory(config: Config) -> Iterator[str]:
    """The results go to a directory that is there, or can be made, and can be written."""
    if config.stage != "verify" and keeps_numbers(Path(config.paths.outputs)):
        permitted = f"a directory without {KEPT_FILE}, which says that it keeps numbers alone, but for stage=verify"
        yield refusal("paths.outputs", config.paths.outputs, permitted)
    elif not (writable_directory(config.paths.outputs) or has_results(config.paths.outputs)):
        yield refusal("paths.outputs", config.paths.outputs, "a directory that can be written")


def has_results(text: str) -> bool:
    """Tell whether a directory has artifacts that can be read: those that are finished need no right to write."""
    try:
        return os.access(Path(text).expanduser() / "artifacts", os.R_OK | os.X_OK)
    except (OSError, RuntimeError):
        return False


def writable_directory(text: str) -> bool:
    """Tell whether files can be made in a directory, which need not be there yet."""
    if text.startswith("~"):  # of nobody, or it would be expanded
        return False
    try:
        path = Path(text).absolute()
        nearest = next(place for place in (path, *path.parents) if place.exists())
    except OSError:  # a name that is too long
        return False
    limit = os.pathconf(nearest, "PC_PATH_MAX")
    missing = path.relative_to(nearest).parts
    longest = os.pathconf(nearest, "PC_NAME_MAX")
    if len(os.fsencode(path)) + LONGEST_BELOW > limit or any(len(os.fsencode(part)) > longest for part in missing):
        return False
    return nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)


def is_file(text: str) -> bool:
    """Tell whether there is a file at a path."""
    try:
        return Path(text).is_file()
    except OSError:
        return False


def is_readable(text: str) -> bool:
    """Tell whether this process may read a file."""
    return os.access(text, os.R_OK)


def tracking_store(config: Config) -> Iterator[str]:
    """MLflow can open the store, and name the experiment."""
    tracking = config.tracking
    if not tracking.enabled:
        return
    if len(tracking.experiment) > LONGEST_EXPERIMENT:
        yield refusal("tracking.experiment", tracking.experiment, f"at most {LONGEST_EXPERIMENT} characters")
    if tracking.uri is not None and tracking.uri.partition("://")[2].partition("/")[0].count("@") > 1:
        yield refusal("tracking.uri", redacted(tracking.uri), "one @; write %40 for an @ in a password")
    elif tracking.uri is not None and not store_uri(tracking.uri, Path(config.paths.outputs)):
        permitted = "http://HOST:PORT, sqlite:///PATH of a file that can be written, "
        permitted += ", ".join(f"{name}://..." for name in DATABASES)
        yield refusal("tracking.uri", redacted(tracking.uri), f"{permitted}, or null")


def store_uri(uri: str, outputs: Path) -> bool:
    """Tell whether a URI names a server or a database of MLflow's; only `outputs` is made where it is not there."""
    try:
        parts = urlsplit(uri)
        named = bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError:  # a port that is none, brackets that do not close
        return False
    kind = parts.scheme.partition("+")[0]
    path = sqlite_path(uri)
    if path is not None:
        there = path.parent.is_dir() or path.parent.absolute() == outputs.absolute()
        return there and path.name != "" and not path.is_dir() and writable_directory(str(path.parent))
    return named and (parts.scheme in SERVERS or kind in DATABASES)
