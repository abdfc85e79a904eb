"""Fixtures of the fault suite."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from romgrl.tracking.recorder import default_uri
from romgrl.tracking.sending.store import Store
from tests.faults.proxied import MLFLOW, Server, listening, tell
from tests.faults.runs import Told
from tests.faults.tcp_proxy import Proxy
from tests.helpers.artifacts import whole
from tests.helpers.limits import wait_until
from tests.helpers.ports import free_port


@pytest.fixture(scope="session")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty store, whose tables take seconds to make."""
    directory = tmp_path_factory.mktemp("store")
    store = Store(default_uri(directory), directory)
    store.request("search_experiments")
    store.close()
    return directory / "mlflow.db"


@pytest.fixture
def outputs(tmp_path: Path, database: Path) -> Path:
    """An output directory with a store."""
    shutil.copy(database, tmp_path)
    return tmp_path


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    """What is there once something was executed."""
    return tmp_path / "EVIL"


@pytest.fixture
def artifact(tmp_path: Path) -> Path:
    """A small artifact that is whole."""
    return whole(tmp_path / "key")


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """One for the tests of two files, which are in the xdist group `tracking`: it takes seconds to start."""
    directory, port = tmp_path_factory.mktemp("server"), free_port()
    command = [MLFLOW, "server", "--host", "127.0.0.1", "--port", str(port), "--workers", "1"]
    command += ["--backend-store-uri", f"sqlite:///{directory}/server.db"]
    command += ["--artifacts-destination", str(directory / "artifacts")]
    with (directory / "log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
    try:
        wait_until(lambda: listening(port))
        yield Server(directory, port)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@pytest.fixture
def proxy(server: Server) -> Iterator[Proxy]:
    """What a job takes for the server, and a test can spoil."""
    proxy = Proxy(server.port)
    yield proxy
    proxy.set("refuse")


@pytest.fixture
def told(proxy: Proxy, tmp_path: Path, request: pytest.FixtureRequest) -> Told:
    """A job that records through the proxy, in an experiment named like the test."""
    return tell(proxy, tmp_path, request)
