"""Stages that do not need each other run at the same time, each in a process; when one fails, both end."""

from __future__ import annotations

import io
import os
import re
import signal
from collections.abc import Collection
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from rich.console import Console

from romgrl.artifacts import load_tensors, open_artifact
from romgrl.config.schema import STAGES, Config
from romgrl.pipeline import run as pipeline
from romgrl.provenance import stage_graph
from romgrl.provenance.stage_graph import plan, share_threads
from romgrl.provenance.stage_keys import stage_key
from romgrl.runtime import signals
from romgrl.tracking.sending.store import PARENT_TAG
from tests.conftest import Composer
from tests.helpers.fake_stages import wait_for
from tests.helpers.jobs import LIGHT, REAL_TORCH, ROOT, TWO, Command, children, start, trainings
from tests.helpers.limits import LONG, PATIENCE
from tests.helpers.tracked import all_runs


@dataclass
class Training:
    """When and where a fake stage ran."""

    start: float
    end: float
    process: int
    threads: int
    torch_threads: int | None  # none where no torch was there


def times(outputs: Path) -> dict[str, Training]:
    """What the fake stages wrote down."""
    found = {}
    for line in (outputs / "artifacts" / "times.txt").read_text(encoding="utf-8").splitlines():
        stage, begin, end, *numbers = line.split()
        process, threads, given = numbers
        torch_threads = None if given == "none" else int(given)
        found[stage] = Training(float(begin), float(end), int(process), int(threads), torch_threads)
    return found


def test_plan() -> None:
    there = {"teacher", "reference"}
    assert plan(STAGES, lambda stage: False) == list(STAGES)
    assert plan(["report"], lambda stage: False) == list(STAGES)
    assert plan(["evaluation"], there.__contains__) == ["reference", "student", "baseline", "evaluation"]
    assert plan(["reference"], there.__contains__) == ["reference"]
    assert plan(["baseline"], there.__contains__) == ["baseline"]


def test_threads_are_shared_by_stages_that_can_run_side_by_side() -> None:
    half = dict.fromkeys(("teacher", "reference", "student", "baseline"), 4)
    assert share_threads(STAGES, 8) == half | {"evaluation": 8, "report": 8}
    assert share_threads(["teacher", "reference", "student", "evaluation"], 8) == dict.fromkeys(
        ("teacher", "reference", "student", "evaluation"), 8
    )
    assert share_threads(["student", "baseline"], 3) == {"student": 1, "baseline": 1}


def test_the_baseline_trains_beside_the_others(command: Command, tmp_path: Path) -> None:
    result = command(*TWO, "tracking=none", FAKE_SECONDS="1", **REAL_TORCH)
    assert (result.returncode, result.stderr) == (0, "")
    found = times(tmp_path / "outputs")
    teacher, reference, student, baseline = (found[name] for name in ("teacher", "reference", "student", "baseline"))
    assert max(teacher.start, baseline.start) < min(teacher.end, baseline.end)
    assert teacher.end <= reference.start < reference.end <= student.start
    assert max(student.end, baseline.end) <= found["evaluation"].start
    assert teacher.process != baseline.process
    assert {(training.threads, training.torch_threads) for training in (teacher, reference, student, baseline)} == {
        (1, 1)
    }
    assert (found["evaluation"].threads, found["evaluation"].torch_threads) == (2, 2)
    assert len(trainings(tmp_path / "outputs")) == len(STAGES)
    for stage in STAGES:
        manifest = next((tmp_path / "outputs" / "artifacts" / stage).glob("*/manifest.json")).parent
        assert open_artifact(manifest).threads == found[stage].threads
        assert (manifest / "curve.csv").read_text(encoding="utf-8").split() == [
            "step,loss",
            "0,0.0",
            "10,1.0",
            "20,2.0",
        ]


@pytest.mark.parametrize("override", ["threads=1", "parallel_stages=false"])
def test_stages_follow_each_other_where_asked(command: Command, tmp_path: Path, override: str) -> None:
    options = TWO[:1] if override == "threads=1" else TWO
    result = command(*options, "tracking=none", override)
    assert result.returncode == 0, result.stderr
    found = list(times(tmp_path / "outputs").values())
    assert len({training.process for training in found}) == 1
    assert all(one.end <= other.start for one, other in pairwise(found))
    assert {training.threads for training in found} == {1 if override == "threads=1" else 2}


def test_a_stage_that_runs_alone_gets_all_threads(command: Command, tmp_path: Path) -> None:
    assert command(*TWO, "tracking=none", "stage=baseline").returncode == 0
    assert command(*TWO, "tracking=none").returncode == 0
    assert {training.threads for training in times(tmp_path / "outputs").values()} == {2}


@pytest.mark.slow
def test_every_stage_is_a_run_of_its_own(command: Command, tmp_path: Path) -> None:
    result = command(*TWO, FAKE_SECONDS="1")
    assert (result.returncode, result.stderr) == (0, "")
    runs = all_runs(tmp_path / "outputs")
    assert sorted(run.data.tags["stage"] for run in runs) == sorted(["job", *STAGES])
    named = {run.data.tags["stage"]: run for run in runs}
    assert {named[stage].data.tags[PARENT_TAG] for stage in STAGES} == {named["job"].info.run_id}
    teacher, baseline = named["teacher"].info, named["baseline"].info
    assert max(teacher.start_time, baseline.start_time) < min(teacher.end_time, baseline.end_time)
    assert all(named[stage].data.metrics["loss"] == 2.0 for stage in STAGES)
    assert named["baseline"].data.tags["threads"] == "1"


@pytest.mark.slow
def test_a_sweep_runs_stages_side_by_side(command: Command, tmp_path: Path) -> None:
    result = command("-m", *TWO, "tracking=none", "stage=evaluation", "speed=1,4")
    assert result.returncode == 0, result.stderr
    stages = [line.split()[0] for line in trainings(tmp_path / "outputs")]
    counts = {stage: stages.count(stage) for stage in stages}
    assert counts == {"teacher": 1, "reference": 1, "student": 2, "baseline": 2, "evaluation": 2}


def partials(outputs: Path) -> dict[str, list[str]]:
    """The files in what unfinished stages left, by stage."""
    left = (outputs / "artifacts").glob("*/*.partial")
    return {path.parent.name: sorted(file.name for file in path.iterdir()) for path in left}


def test_a_failure_stops_the_other_stage(command: Command, tmp_path: Path) -> None:
    result = command(*TWO, FAKE_FAULT="baseline:diverge", FAKE_FAULT_CALLS="2", FAKE_SECONDS=LONG)
    assert (result.returncode, result.stderr) == (4, "baseline: loss = nan at step 7\n")
    assert re.search(r"teacher: interrupted after 0:\d\d; kept /.*\.partial", result.stdout)
    assert re.search(r"baseline: failed after 0:\d\d; kept /.*\.partial", result.stdout)
    assert partials(tmp_path / "outputs") == {"baseline": ["half.npz"], "teacher": ["half.npz"]}
    status = {run.data.tags["stage"]: run.info.status for run in all_runs(tmp_path / "outputs")}
    assert status == {"job": "FAILED", "teacher": "KILLED", "baseline": "FAILED"}


def test_a_process_that_dies_is_named(tmp_path: Path) -> None:
    """As when the system runs out of memory and kills it."""
    outputs = tmp_path / "outputs"
    job = start(*TWO, "tracking=none", f"paths.outputs={outputs}", FAKE_SECONDS=LONG)
    wait_for(outputs / "artifacts" / "calls.txt", 2)
    os.kill(children(job.pid)[0], signal.SIGKILL)
    _, err = job.communicate(timeout=PATIENCE)
    assert job.returncode == 1
    assert re.fullmatch(r"(baseline|teacher): its process ended with SIGKILL\n", err)


@pytest.mark.parametrize(("number", "to_all"), [(signal.SIGINT, False), (signal.SIGTERM, True), (signal.SIGHUP, False)])
def test_signals_end_both_in_good_order(tmp_path: Path, number: signal.Signals, to_all: bool) -> None:
    """A terminal signals the job, a scheduler every process; checkpoints of both stages are kept."""
    outputs = tmp_path / "outputs"
    job = start(*TWO, "tracking=none", f"paths.outputs={outputs}", FAKE_SECONDS=LONG)
    wait_for(outputs / "artifacts" / "calls.txt", 2)
    workers = children(job.pid)
    assert len(workers) == 2
    for process in [*workers, job.pid] if to_all else [job.pid]:
        os.kill(process, number)
    out, err = job.communicate(timeout=PATIENCE)
    assert (job.returncode, err) == (128 + number, "")
    assert len(re.findall(r"(?:teacher|baseline): interrupted after 0:\d\d; kept /.*\.partial", out)) == 2
    assert partials(outputs) == {"baseline": ["half.npz"], "teacher": ["half.npz"]}
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)


@pytest.mark.usefixtures("fakes")
def test_a_signal_leaves_no_lock_held(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """It comes where the thread that waits for the stages holds the lock of one, which its own thread needs to end."""
    monkeypatch.setenv("FAKE_SECONDS", LONG)
    sent = [signal.SIGINT]

    def interrupted(futures: Collection[Future[None]], *arguments: Any, **named: Any) -> Any:
        for future in futures if sent else []:
            future._condition.acquire()
        if sent:
            signal.raise_signal(sent.pop())
            for future in futures:
                future._condition.release()
        return wait(futures, *arguments, **named)

    monkeypatch.setattr(pipeline, "wait", interrupted)
    config = replace(smoke_config, threads=2, tracking=replace(smoke_config.tracking, enabled=False))
    with pytest.raises(signals.Interrupted):
        pipeline.run(config, console=Console(file=io.StringIO()))


@pytest.mark.usefixtures("fakes")
def test_a_job_that_waits_for_another_can_be_interrupted(tmp_path: Path, compose_config: Composer) -> None:
    outputs = tmp_path / "outputs"
    key = stage_key("baseline", compose_config(*TWO), {})
    (outputs / "artifacts" / "baseline").mkdir(parents=True)
    with FileLock(outputs / "artifacts" / "baseline" / f".{key}.lock"):
        job = start(*TWO, "tracking=none", f"paths.outputs={outputs}")
        wait_for(outputs / "artifacts" / "calls.txt", 3)
        assert job.stdout is not None
        waiting = f"baseline: {key} is being made by another process; waiting for it"
        assert any(waiting in line for line in job.stdout)
        job.send_signal(signal.SIGINT)
        _, err = job.communicate(timeout=PATIENCE)
    assert (job.returncode, err) == (130, "")


@pytest.mark.usefixtures("fakes")
def test_a_terminal_shows_a_bar_for_each(smoke_config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_SECONDS", "1.5")
    monkeypatch.setenv("PYTHONPATH", f"{LIGHT}:{ROOT}")
    config = replace(smoke_config, threads=2, tracking=replace(smoke_config.tracking, enabled=False))
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    pipeline.run(config, console=console)
    shown = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", console.file.getvalue())
    frames = re.findall(r"\S (teacher|baseline) +━+ +0%.*\n\S (teacher|baseline) +━+ +0%", shown)
    assert {"teacher", "baseline"} in [set(frame) for frame in frames]


@pytest.mark.slow
def test_a_stage_makes_the_same_bits_beside_another(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real teacher and baseline with one thread each, in turn and side by side."""
    for stage in ("reference", "student", "evaluation", "report"):
        fake = replace(stage_graph.STAGES[stage], function="tests.helpers.fake_stages:run")
        monkeypatch.setitem(stage_graph.STAGES, stage, fake)
    policies = []
    for override, parallel in (("threads=1", False), ("threads=2", True)):
        config = compose_config("experiment=smoke", override, "tracking=none", f"paths.outputs={tmp_path}/{parallel}")
        for stage in ("all",) if parallel else ("teacher", "baseline"):
            pipeline.run(replace(config, stage=stage), console=Console(file=io.StringIO()))
        for stage in ("teacher", "baseline"):
            (policy,) = (tmp_path / str(parallel) / "artifacts" / stage).glob("*/policy.safetensors")
            assert open_artifact(policy.parent).threads == 1
            policies.append(load_tensors(policy)[0])
    for alone, beside in zip(policies[:2], policies[2:], strict=True):
        assert all(alone[name].equal(beside[name]) for name in alone)
