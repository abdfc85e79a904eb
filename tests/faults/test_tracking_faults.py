"""A tracking server that goes away in every way, behind a proxy: training goes on; nothing is lost or there twice."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from romgrl.errors import TrackingError
from romgrl.tracking.journal import journals
from romgrl.tracking.recorder import bring_journals
from tests.faults.proxied import Server, check, connected, process_of, tell
from tests.faults.runs import Told, stored
from tests.faults.tcp_proxy import Proxy
from tests.helpers.jobs import start
from tests.helpers.limits import PATIENCE, wait_until

pytestmark = pytest.mark.xdist_group("tracking")  # one server for all of them


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


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["refuse", "hang"])
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
            wait_until(lambda hits=hits: proxy.hits == hits)
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
