"""What a failed request to MLflow means: the store is away, or it is there and does not take this one; in words."""

from __future__ import annotations

import errno
import re
import shlex
import sqlite3
from json import JSONDecodeError
from pathlib import Path
from urllib.parse import urlsplit

import mlflow
from mlflow.exceptions import MlflowException
from sqlalchemy.exc import SQLAlchemyError

from romgrl.config.addresses import sqlite_path


class ExperimentError(Exception):
    """An experiment was deleted, and its name is taken all the same: nothing can be stored until somebody mends it."""


FAILURES = (MlflowException, SQLAlchemyError, sqlite3.Error, OSError, JSONDecodeError, ExperimentError)
"""Of a store that is away, or where nothing can be stored."""
REFUSED = {"INVALID_PARAMETER_VALUE", "RESOURCE_DOES_NOT_EXIST"}  # whenever it is sent
TRIES = 3  # of a request that fails while others are answered, before it is set aside
AUTHORIZATION = (401, 403)
BUSY = (408, 425, 429, 502, 503, 504)  # HTTP statuses that pass
OF_FILES = {
    getattr(errno, name)
    for name in ("EACCES", "EPERM", "EROFS", "ENOENT", "ENOTDIR", "EISDIR", "EEXIST", "ENOSPC", "EDQUOT")
}  # errors of a disk, which say nothing about a store
STATUS = re.compile(r"failed with error code (\d{3})|too many (\d{3}) error responses")
NO_ANSWER = re.compile(r"^API request to \S+ failed with (timeout )?exception")
DELETED = re.compile(r"must be in the 'active' state|[Rr]un .* not found|No Run with id")
OF_SQLALCHEMY = "(raised as a result of"  # before the line that says what went wrong
SCHEMA = re.compile(r"out-of-date database schema \(found version (\w+), but expected (\w+)\)")


class RefusedError(Exception):
    """The store will never take a request."""


class FilesError(Exception):
    """The store answers, but the files of a run cannot be stored where it keeps them."""


def first_line(error: BaseException) -> str:
    """What went wrong, on one line."""
    lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith(OF_SQLALCHEMY)]
    return (lines or [type(error).__name__])[0]


def status_of(error: BaseException) -> int | None:
    """The HTTP status of an answer that was a failure; None where there was no answer."""
    response = getattr(error, "response", None)
    if response is not None:
        return int(response.status_code)
    if not isinstance(error, MlflowException):
        return None
    if found := STATUS.search(str(error)):
        return int(found[1] or found[2])
    return None if NO_ANSWER.match(str(error)) else int(error.get_http_status_code())


def tries_of(do: str, error: BaseException) -> int | None:
    """After how many tries a request is set aside, if the store answers another one; None: never, it waits.

    Files often go to a place of their own, so what fails there holds nothing back.
    """
    status = status_of(error)
    if do == "artifacts":
        passing = isinstance(error, FAILURES) and not of_files(error) and (status is None or status in (*BUSY, 500))
        return TRIES if passing else 1
    if status is None or status in (*BUSY, *AUTHORIZATION):
        return None
    return 1 if 400 <= status < 500 else TRIES


def of_files(error: BaseException) -> bool:
    """Tell whether a disk failed, and not a connection."""
    return isinstance(error, OSError) and not isinstance(error, ConnectionError) and error.errno in OF_FILES


def explained(error: BaseException, uri: str) -> str:
    """What went wrong and what to do about it, on one line."""
    text, line, host = str(error), first_line(error), urlsplit(uri).netloc.rpartition("@")[2]
    if found := SCHEMA.search(text):
        return other_version(found[1], uri)
    if "Invalid Host header" in text:
        return f"it refuses the name {host}: start it with --allowed-hosts {shlex.quote(host)}, and its other names"
    if "CERTIFICATE_VERIFY_FAILED" in text or "certificate verify failed" in text:
        return (
            "its certificate is not trusted: MLFLOW_TRACKING_SERVER_CERT_PATH names the file of the one that signed it"
        )
    status = status_of(error)
    if "response body was not in a valid JSON format" in text or (status == 404 and "<html" in text.lower()):
        return "what answers there is no MLflow server"
    if status == 401:
        return "401, it wants to know the user: set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD, or _TOKEN"
    if status == 403:
        return f"403, this user may not do that: {line}"
    return f"it answers {status}" if status is not None and "Max retries exceeded" in text else line


def other_version(found: str, uri: str) -> str:
    """What to do about a database whose tables another MLflow made."""
    migrations = Path(mlflow.__file__).parent / "store" / "db_migrations" / "versions"
    if not any(migrations.glob(f"{found}*.py")):
        return f"its tables are those of a newer MLflow than the {mlflow.__version__} that is installed here"
    backup = ""
    if (file := sqlite_path(uri)) is not None:
        backup = f"cp {shlex.quote(str(file))} {shlex.quote(f'{file}.backup')} && "
    else:
        backup = "make a backup of the database, then "
    return f"its tables are those of an older MLflow: {backup}mlflow db upgrade {shlex.quote(uri)}"


def why_no_files(error: BaseException, root: str, *, served: bool) -> str:
    """Why files cannot be stored under `root`, and what to do about it. `served`: by a server."""
    status, line, scheme = status_of(error), first_line(error), urlsplit(root).scheme
    if of_files(error) and served and scheme in ("file", ""):
        return (
            f"they would go to {root}, which this machine cannot write ({line}); the server needs --serve-artifacts; "
            f"an experiment keeps its place, so then: stage=sync tracking.experiment=NEW"
        )
    if isinstance(error, ImportError):
        return f"they would go to {root}, for which a library is missing here ({line})"
    if status is not None:
        too_large = " (too large for a proxy before it)" if status == 413 else ""
        return f"they would go to {root}, and the answer is {status}{too_large}"
    return f"they would go to {root}: {type(error).__name__}: {line}"
