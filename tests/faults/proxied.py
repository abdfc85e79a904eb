"""A real `mlflow server` behind a proxy, a job that records through it, and what has to arrive."""

from __future__ import annotations

import sys
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path

import pytest

from romgrl.tracking.journal import journals
from romgrl.tracking.process import BLOCKED_SECONDS
from romgrl.tracking.recorder import Recorder, open_recorder
from tests.faults.runs import FILES, Told, differences, stored
from tests.faults.tcp_proxy import Proxy
from tests.helpers.limits import SLACK

LIMIT = BLOCKED_SECONDS + SLACK  # that a job may be blocked in all

MLFLOW = str(Path(sys.executable).with_name("mlflow"))


@dataclass
class Server:
    """A real `mlflow server` with its own database and files."""

    directory: Path
    port: int

    @property
    def database(self) -> Path:
        return self.directory / "server.db"

    def files(self, run_id: str) -> dict[str, bytes]:
        """Every file of a run."""
        (root,) = (self.directory / "artifacts").rglob(f"{run_id}/artifacts")
        return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def listening(port: int) -> bool:
    try:
        urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=2).close()
    except OSError:
        return False
    return True


def tell(proxy: Proxy, outputs: Path, request: pytest.FixtureRequest, mode: str = "open") -> Told:
    proxy.set(mode)
    begin = time.perf_counter()
    recorder = open_recorder(proxy.uri, request.node.name, outputs, enabled=True)
    return Told(recorder, outputs / "published", blocked=time.perf_counter() - begin)


def check(told: Told, server: Server, request: pytest.FixtureRequest, status: str = "FINISHED") -> None:
    """All that was told is in the store, once, with its files; the job was not held up."""
    found = stored(server.database, request.node.name)
    lost, twice = differences(told, found, status)
    (stage,) = [run_id for name, _, run_id in found.runs if name == "stage"]
    files = server.files(stage) if status == "FINISHED" else {}
    assert files == (FILES if status == "FINISHED" else {})
    print(
        f"{request.node.name}: {len(told.points)} points, {len(found.runs)} runs, {len(files)} files: "
        f"{lost} lost, {twice} twice, blocked {told.blocked:.2f} s"
    )
    assert (lost, twice) == (0, 0)
    assert told.blocked <= LIMIT
    assert journals(told.directory.parent) == []


def connected(told: Told) -> bool:
    return len(process_of(told.recorder).run_ids) == 2


def process_of(recorder: Recorder):
    assert recorder.process is not None
    return recorder.process
