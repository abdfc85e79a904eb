"""Many processes that need one artifact: one makes it, the others wait and use it, and a dead owner is taken over."""

from __future__ import annotations

import io
import multiprocessing
import os
import re
import signal
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing.synchronize import Barrier
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.artifacts import open_artifact
from romgrl.artifacts.locks import Owner, exclusive, waited_for
from romgrl.artifacts.workspace import Workspace
from romgrl.config.schema import Config
from romgrl.pipeline import run as pipeline
from romgrl.pipeline.worker import working_lock
from romgrl.provenance.stage_keys import stage_key
from tests.helpers import fake_stages
from tests.helpers.jobs import TWO, children, start, trainings
from tests.helpers.limits import LONG, PATIENCE, wait_until

PROCESSES, ROUNDS = 8, 20
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["torch", "romgrl.pipeline.run", "tests.helpers.fake_stages"])


@pytest.fixture
def teacher(smoke_config: Config) -> Config:
    """The teacher alone, without MLflow."""
    return replace(smoke_config, stage="teacher", tracking=replace(smoke_config.tracking, enabled=False))


def run(config: Config, seconds: float = 0.0) -> str:
    """One job with fake stages; what it said."""
    os.environ["FAKE_SECONDS"] = str(seconds)
    fake_stages.install()
    console = Console(file=io.StringIO(), width=200)
    pipeline.run(config, console=console)
    return console.file.getvalue()


def rounds(config: Config, barrier: Barrier, said: Path) -> None:
    """Need one teacher after the other, each at the same moment as the other processes."""
    for seed in range(ROUNDS):
        barrier.wait(PATIENCE)
        with said.open("a", encoding="utf-8") as file:
            file.write(run(replace(config, seed=seed), seconds=0.1))


def test_one_of_many_processes_makes_it(teacher: Config, tmp_path: Path) -> None:
    barrier = CONTEXT.Barrier(PROCESSES)
    logs = [tmp_path / f"{number}.txt" for number in range(PROCESSES)]
    processes = [CONTEXT.Process(target=rounds, args=(teacher, barrier, log)) for log in logs]
    for process in processes:
        process.start()
    for process in processes:
        process.join(PATIENCE)
    assert [process.exitcode for process in processes] == [0] * PROCESSES
    made = len(trainings(Path(teacher.paths.outputs)))
    text = "".join(log.read_text(encoding="utf-8") for log in logs)
    waited = re.findall(r"is being made by (?:process (\d+) on \S+ since \S+|another process); waiting for it", text)
    print(f"{PROCESSES} processes x {ROUNDS} rounds: {made} trainings, {len(waited)} waits")
    assert made == ROUNDS
    assert text.count("teacher: done in") == ROUNDS
    assert text.count("teacher: reused") == (PROCESSES - 1) * ROUNDS
    assert {int(process) for process in waited if process} <= {process.pid for process in processes}
    assert any(waited)


@pytest.mark.parametrize("takeovers", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_a_dead_owner_is_taken_over(teacher: Config, tmp_path: Path, takeovers: int) -> None:
    taken = 0
    artifacts = Path(teacher.paths.outputs) / "artifacts" / "teacher"
    for seed in range(takeovers):
        config = replace(teacher, seed=seed)
        owner = CONTEXT.Process(target=run, args=(config, PATIENCE))
        owner.start()
        wait_until(lambda: artifacts.is_dir() and any(artifacts.glob("*.partial")))
        log = tmp_path / f"{seed}.txt"
        heir = CONTEXT.Process(target=write_down, args=(config, log))
        heir.start()
        if seed % 2:  # some are waiting when the owner dies, some come later
            time.sleep(0.2)
        assert owner.pid is not None
        os.kill(owner.pid, signal.SIGKILL)
        owner.join(PATIENCE)
        heir.join(PATIENCE)
        assert heir.exitcode == 0
        assert f"was left behind by process {owner.pid} on " in log.read_text(encoding="utf-8")
        (published,) = (path for path in artifacts.iterdir() if path.is_dir())
        open_artifact(published, stage="teacher")
        taken += 1
        published.rename(tmp_path / f"published-{seed}")
    print(f"owner killed: taken over {taken} of {takeovers}, one published each")
    made = Counter(trainings(Path(teacher.paths.outputs)))  # by an owner, too, where it came so far
    assert len(made) == takeovers
    assert set(made.values()) <= {1, 2}


def write_down(config: Config, log: Path) -> None:
    """Run a job and keep what it said."""
    log.write_text(run(config), encoding="utf-8")


def test_who_waits_leaves_the_owner_alone(tmp_path: Path) -> None:
    """A job that is stopped while it waits neither takes the lock nor wipes out whose it is."""
    place, said = tmp_path / "teacher" / "key", list[str]()
    with exclusive(place, say=said.append, stopping=lambda: False):
        waiting = exclusive(place, say=said.append, stopping=lambda: True)
        with pytest.raises(KeyboardInterrupt), waiting:
            pytest.fail("the lock was given twice")
        assert str(Owner(place)).startswith(f"process {os.getpid()} on ")
    assert str(Owner(place)) == "another process"
    assert said == [said[0]]


def test_a_killed_pipeline_takes_its_workers_with_it(tmp_path: Path) -> None:
    """Whoever takes over is alone: a worker that went on would write into the same workspace."""
    outputs = tmp_path / "outputs"
    job = start(*TWO, "tracking=none", f"paths.outputs={outputs}", FAKE_SECONDS=LONG)
    wait_until(lambda: len(notes(outputs)) == 2)
    workers = children(job.pid)
    assert len(workers) == 2
    job.kill()
    job.wait()
    wait_until(lambda: not any(alive(worker) for worker in workers))


def alive(process: int) -> bool:
    """Tell whether a process exists and has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def notes(outputs: Path) -> list[str]:
    """What the fake stages wrote down so far."""
    path = outputs / "artifacts" / "calls.txt"
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


def test_a_job_that_is_stopped_does_not_wait_for_an_old_worker(tmp_path: Path) -> None:
    output = tmp_path / "key.partial"
    with working_lock(output):
        waiting = waited_for(working_lock(output), lambda: True)
        with pytest.raises(KeyboardInterrupt), waiting:
            pytest.fail("the lock was given twice")


@pytest.mark.usefixtures("fakes")
def test_a_stage_waits_until_an_old_worker_is_gone(teacher: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    opened, original = threading.Event(), Workspace.open
    monkeypatch.setattr(Workspace, "open", lambda workspace: (opened.set(), original(workspace))[1])
    place = Path(teacher.paths.outputs) / "artifacts" / "teacher" / stage_key("teacher", teacher, {})
    place.parent.mkdir(parents=True)
    with ThreadPoolExecutor(1) as pool:
        with working_lock(place.with_name(f"{place.name}.partial")):
            made = pool.submit(pipeline.run, teacher, console=Console(file=io.StringIO()))
            wait_until(lambda: Owner(place).path.exists())
            assert not opened.wait(0.5)
        assert made.result(PATIENCE)["teacher"] == place
