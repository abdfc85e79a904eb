"""The process that sends to a tracking server, the job and the server's own: killed, standing still, listening."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from romgrl.tracking.journal import journals
from romgrl.tracking.recorder import bring_journals, default_uri, open_recorder, ui_command
from tests.faults.proxied import MLFLOW, Server, check, connected, listening, process_of
from tests.faults.runs import Told
from tests.faults.tcp_proxy import Proxy
from tests.helpers.jobs import ROOT
from tests.helpers.limits import PATIENCE, wait_until
from tests.helpers.ports import free_port

pytestmark = pytest.mark.xdist_group("tracking")  # one server for all of them


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
