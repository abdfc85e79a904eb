"""Real servers on loopback for a test: PostgreSQL, and `mlflow server` in front of a database."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.helpers.limits import wait_until
from tests.helpers.ports import free_port

UNPRIVILEGED = "nobody"  # runs PostgreSQL where the tests run as root, which it refuses


@contextmanager
def mlflow_server(directory: Path, database: str) -> Iterator[str]:
    """An address of MLflow with its runs in `database` and its files in `directory`."""
    port = free_port()
    command = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(port), "--workers", "1"]
    command += ["--backend-store-uri", database, "--serve-artifacts", "--artifacts-destination", str(directory)]
    with (directory.parent / "mlflow.log").open("w", encoding="utf-8") as log, process(command, log.fileno()):
        wait_until(lambda: answers(f"http://127.0.0.1:{port}/health"))
        yield f"http://127.0.0.1:{port}"


@contextmanager
def postgresql() -> Iterator[str]:
    """The address of an empty database; skips where PostgreSQL or its driver is missing."""
    programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    initdb = shutil.which("initdb") or (programs[-1] if programs else None)
    if initdb is None or find_spec("psycopg") is None:
        pytest.skip("PostgreSQL (initdb, postgres) or its driver psycopg is not installed")
    programs_of = Path(initdb).resolve().parent
    user = UNPRIVILEGED if os.geteuid() == 0 else None
    directory = Path(tempfile.mkdtemp(prefix="romgrl-postgresql-"))  # a short path that the user may reach
    port = free_port()
    try:
        if user is not None:
            os.chown(directory, pwd.getpwnam(user).pw_uid, -1)
        data, environment = directory / "data", {"PATH": os.environ["PATH"], "LC_ALL": "C", "HOME": str(directory)}
        make = [str(initdb), "--pgdata", str(data), "--username", "romgrl", "--auth", "trust", "--encoding", "UTF8"]
        subprocess.run(make, check=True, user=user, env=environment, cwd=directory, stdout=subprocess.DEVNULL)
        server = [str(programs_of / "postgres"), "-D", str(data), "-p", str(port), "-k", str(directory)]
        with (
            (directory / "log").open("w", encoding="utf-8") as log,
            process([*server, "-h", "127.0.0.1", "-F"], log.fileno(), user),
        ):
            ready = [str(programs_of / "pg_isready"), "-q", "-h", "127.0.0.1", "-p", str(port)]
            wait_until(lambda: subprocess.run(ready, check=False).returncode == 0)
            yield f"postgresql+psycopg://romgrl@127.0.0.1:{port}/postgres"
    finally:
        shutil.rmtree(directory)


@contextmanager
def process(command: list[str], log: int, user: str | None = None) -> Iterator[None]:
    """Run a server with all that it starts, and end all of it."""
    running = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True, user=user)
    try:
        yield
    finally:
        os.killpg(running.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            running.wait(10)
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
        running.wait()


def answers(address: str) -> bool:
    """Tell whether a server answers."""
    try:
        urllib.request.urlopen(address, timeout=2).close()
    except OSError:
        return False
    return True
