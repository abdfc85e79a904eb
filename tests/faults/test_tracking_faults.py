"""A tracking server that goes away in every way, behind a proxy: training goes on; nothing is lost or there twice."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from romgrl.errors import TrackingError
from romgrl.tracking.journal import journals
from romgrl.tracking.process import BLOCKED_SECONDS
from romgrl.tracking.recorder import Recorder, bring_journals, default_uri, open_recorder, ui_command
from tests.faults.ports import free_port
from tests.faults.runs import FILES, Told, differences, stored
from tests.faults.tcp_proxy import Proxy
from tests.helpers.jobs import ROOT, start
from tests.helpers.limits import PATIENCE, SLACK, wait_until

pytestmark = pytest.mark.xdist_group("tracking")  # one server for all of them
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


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
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
    proxy = Proxy(server.port)
    yield proxy
    proxy.set("refuse")


@pytest.fixture
def told(proxy: Proxy, tmp_path: Path, request: pytest.FixtureRequest) -> Told:
    """A job that records through the proxy, in an experiment named like the test."""
    return tell(proxy, tmp_path, request)


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


def process_of(recorder: Recorder):  # type: ignore[no-untyped-def]
    assert recorder.process is not None
    return recorder.process


@pytest.mark.slow
def test_away_at_the_start_and_back(
    proxy: Proxy, server: Server, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    told = tell(proxy, tmp_path, request, "refuse")
    told.start()
    with told.timed():
        assert told.stage.run_id == told.stage.local_id
    told.steps(0, 50)
    wait_until(lambda: process_of(told.recorder)._said_anything)
    proxy.set("open")
    told.steps(50, 100)
    wait_until(lambda: connected(told))
    assert not told.finish().startswith("local:")
    check(told, server, request)


@pytest.mark.parametrize("mode", ["refuse", pytest.param("hang", marks=pytest.mark.slow)])
def test_away_in_the_middle_and_back(
    told: Told, proxy: Proxy, server: Server, request: pytest.FixtureRequest, mode: str
) -> None:
    told.start()
    wait_until(lambda: connected(told))
    told.steps(0, 50)
    proxy.set(mode)
    told.steps(50, 100)
    wait_until(lambda: process_of(told.recorder).reason is not None)
    told.steps(100, 150)
    proxy.set("open")
    wait_until(lambda: process_of(told.recorder).reason is None)
    told.finish()
    check(told, server, request)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["refuse", "hang"])
def test_never_back_then_sync(
    proxy: Proxy,
    server: Server,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
    mode: str,
) -> None:
    told = tell(proxy, tmp_path, request, mode)
    told.start()
    told.steps(0, 100)
    run_id = told.finish()
    assert run_id == told.stage.local_id
    assert capsys.readouterr().err.count("python -m romgrl stage=sync") == 1
    wait_until(lambda: not process_of(told.recorder).alive)
    with pytest.raises(TrackingError, match=f"MLflow at {proxy.uri}: .*stays in {tmp_path}/journal"):
        bring_journals(None, tmp_path)
    proxy.set("open")
    lines = bring_journals(None, tmp_path)
    ids = {name: found for name, _, found in stored(server.database, request.node.name).runs}
    assert sum(line.startswith(f"{run_id} is {ids['stage']}: ") for line in lines) == 1
    check(told, server, request)
    assert bring_journals(None, tmp_path) == ["nothing is left to bring to MLflow"]


@pytest.mark.slow
def test_hanging_when_the_job_ends(told: Told, proxy: Proxy, server: Server, request: pytest.FixtureRequest) -> None:
    told.start()
    wait_until(lambda: connected(told))
    proxy.set("hang")
    told.steps(0, 100)
    told.finish()
    wait_until(lambda: not process_of(told.recorder).alive)
    proxy.set("open")
    bring_journals(None, told.directory.parent)
    check(told, server, request)


@pytest.mark.slow
def test_slow_answers_are_not_waited_for(
    told: Told, proxy: Proxy, server: Server, request: pytest.FixtureRequest
) -> None:
    """The process goes on after the job, as the store answers."""
    told.start()
    wait_until(lambda: connected(told))
    proxy.set("slow")
    told.steps(0, 100)
    told.finish()
    assert process_of(told.recorder).alive
    proxy.set("open")
    wait_until(lambda: not process_of(told.recorder).alive)
    bring_journals(None, told.directory.parent)
    check(told, server, request)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["swallow", "cut"])
def test_answers_that_get_lost(
    told: Told, proxy: Proxy, server: Server, request: pytest.FixtureRequest, fault: str
) -> None:
    """The server did what was asked: made the run, took numbers and files; only the answer is not there."""
    for hits, mark in enumerate((b"runs/create", b"runs/log-batch", b"PUT /api"), 1):
        proxy.set(fault, mark)
        if hits == 1:
            told.start()
        told.steps(50 * hits, 50 * hits + 50)
        if hits < 3:
            wait_until(lambda hits=hits: proxy.hits == hits)  # type: ignore[misc]
            wait_until(lambda: connected(told) and process_of(told.recorder).reason is None)
    told.finish()
    wait_until(lambda: not process_of(told.recorder).alive)
    if journals(told.directory.parent):
        bring_journals(None, told.directory.parent)
    assert proxy.hits == 3
    check(told, server, request)


@pytest.mark.slow
def test_a_request_that_arrives_after_it_was_given_up(
    told: Told, proxy: Proxy, server: Server, request: pytest.FixtureRequest
) -> None:
    """Then a run is made twice; the second one goes."""
    proxy.set("late", b"runs/create")
    told.start()
    wait_until(lambda: connected(told))
    proxy.release.set()
    wait_until(lambda: len(stored(server.database, request.node.name).runs) == 3)
    told.steps(0, 50)
    told.finish()
    check(told, server, request)
    assert stored(server.database, request.node.name).deleted == 1


@pytest.mark.slow
def test_the_process_of_mlflow_is_killed(told: Told, server: Server, request: pytest.FixtureRequest) -> None:
    told.start()
    wait_until(lambda: connected(told))
    told.steps(0, 50)
    process_of(told.recorder).kill()
    told.steps(50, 100)
    told.finish()
    later = open_recorder(told.recorder.uri, request.node.name + " later", told.directory.parent, enabled=True)
    assert later is not told.recorder
    wait_until(lambda: len(journals(told.directory.parent)) == 1)  # a later job brings what is left, too
    later.close()
    check(told, server, request)


@pytest.mark.slow
def test_the_process_of_mlflow_stands_still(
    told: Told, server: Server, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    told.start()
    wait_until(lambda: connected(told))
    os.kill(process_of(told.recorder)._process.pid, signal.SIGSTOP)
    told.steps(0, 100)
    told.finish()
    assert capsys.readouterr().err.count("failed (no answer); going on") == 1
    process_of(told.recorder).kill()
    bring_journals(None, told.directory.parent)
    check(told, server, request)


JOB = """
import os, signal, sys, time
from pathlib import Path
from romgrl.tracking.recorder import open_recorder
from tests.faults.runs import Told
recorder = open_recorder(sys.argv[1], sys.argv[2], Path(sys.argv[3]), enabled=True)
told = Told(recorder, Path(sys.argv[3]) / "published")
told.start()
told.steps(0, 50)
assert not str(told.stage.run_id).startswith("local:")
told.steps(50, 100)
os.kill(recorder.process._process.pid, signal.SIGKILL)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_the_job_and_its_process_are_killed(
    told: Told, proxy: Proxy, server: Server, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    outputs = tmp_path / "killed"
    command = [sys.executable, "-c", JOB, proxy.uri, request.node.name, str(outputs)]
    ended = subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=PATIENCE, check=False)
    assert ended.returncode == -signal.SIGKILL
    (path,) = journals(outputs)
    with path.open("ab") as torn:
        torn.write(b'{"run": "')
    assert len(bring_journals(None, outputs)) == 2
    told.expect(0, 100)
    told.directory = outputs / "published"
    check(told, server, request, "KILLED")
    told.recorder.close()


def test_command_line(proxy: Proxy, server: Server, tmp_path: Path) -> None:
    """A stage without its server, and what it prints; then `stage=sync` while it is away, and when it is back."""
    outputs = f"paths.outputs={tmp_path}/outputs"
    options = ("tracking=server", f"tracking.uri={proxy.uri}", "tracking.experiment=command line", outputs)
    proxy.set("refuse")
    job = start("experiment=smoke", "stage=teacher", *options)
    out, err = job.communicate(timeout=PATIENCE)
    assert (job.returncode, err.count("warning: ")) == (0, 2), err
    local = re.findall(r"mlflow run: (local:[0-9a-f]{32})\n", out)
    away = start("stage=sync", outputs)
    _, err = away.communicate(timeout=PATIENCE)
    assert (away.returncode, len(err.splitlines())) == (3, 1), err
    assert f"MLflow at {proxy.uri}: " in err
    proxy.set("open")
    back = start("stage=sync", outputs)
    out, err = back.communicate(timeout=PATIENCE)
    assert (back.returncode, err) == (0, "")
    runs = {name: run_id for name, _, run_id in stored(server.database, "command line").runs}
    (teacher,) = [run_id for name, run_id in runs.items() if name.startswith("teacher v=4 s=0")]
    assert sorted(name.split()[0] for name in runs) == ["job", "teacher"]
    assert [f"{local[0]} is {teacher}: "] == re.findall(rf"{local[0]} is \w+: ", out)
    assert {"manifest.json", "data.npz"} <= server.files(teacher).keys()


@pytest.mark.slow
def test_the_line_that_is_printed_listens_on_loopback_only(tmp_path: Path) -> None:
    port = free_port()
    program, *rest = shlex.split(ui_command(default_uri(tmp_path)))
    command = [MLFLOW if program == "mlflow" else program, *rest, "--port", str(port)]
    environment = os.environ | {"MLFLOW_HOST": "0.0.0.0", "MLFLOW_WORKERS": "1"}
    with (tmp_path / "log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True, env=environment)
    try:
        wait_until(lambda: listening(port))
        addresses = listeners(port)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    print(f"{shlex.join(command)}: {len(addresses)} listening sockets, {addresses}")
    assert addresses == {"0100007F"}  # 127.0.0.1, and nothing in tcp6


def listeners(port: int) -> set[str]:
    """Addresses that a port of this machine is listened to on, as the kernel writes them."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text(encoding="utf-8").splitlines()[1:]:
            _, local, _, state, *_ = line.split()
            address, _, number = local.partition(":")
            if int(number, 16) == port and state == "0A":
                found.add(address)
    return found
