"""kill -9 at any moment, over all stages of a real pipeline: the same command goes on and ends with the same bits."""

from __future__ import annotations

import os
import random
import shutil
import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from romgrl.artifacts import open_artifact
from romgrl.config.schema import STAGES
from tests.helpers.jobs import start
from tests.helpers.limits import PATIENCE, wait_until

FEW, MANY = (1, 1, STAGES[:3], (16_000, 1536)), (50, 10, STAGES, (40_000, 3000))
SMALL = (
    "experiment=smoke",
    "tracking=none",
    "checkpoint_seconds=0.2",
    "evaluation.video=false",
)


@pytest.mark.parametrize(("count", "each", "stages", "steps"), [FEW, pytest.param(*MANY, marks=pytest.mark.slow)])
def test_kill_at_any_moment(
    tmp_path: Path, count: int, each: int, stages: Sequence[str], steps: tuple[int, int]
) -> None:
    """One pipeline after the other, each killed again and again until it has ended; a whole one also on two threads."""
    generator = random.Random(0)
    budgets = [f"{group}.total_steps={number}" for group, number in zip(("teacher", "student"), steps, strict=True)]
    wanted = [f"stage={'all' if stages == STAGES else stages[-1]}", *budgets]
    code, text, whole = run(tmp_path / "whole", wanted, threads=1)
    assert code == 0, text
    expected, kills, pipelines, resumed = digests(tmp_path / "whole", stages), 0, 0, 0
    while kills < count:
        outputs = tmp_path / f"{pipelines}"
        code, until = None, min(kills + each, count)
        while code is None:
            resumed += any(outputs.glob("artifacts/*/*.partial/checkpoint/*.json"))
            spent = generator.uniform(0.1, 0.4) * whole if kills < until else None
            threads = 2 - pipelines % 2 if stages == STAGES else 1  # of which each training has one
            code, text, _ = run(outputs, wanted, threads=threads, seconds=spent)
            kills += code is None
            print(f"{kills} kills, exit code {code}", flush=True)
        assert code == 0, text
        assert digests(outputs, stages) == expected
        assert not [path for path in (outputs / "artifacts").glob("*/*") if path.suffix in (".partial", ".checkpoint")]
        pipelines += 1
        shutil.rmtree(outputs)
    print(f"{kills} kills in {pipelines} pipelines, all ended with the same bits; {resumed} times a training went on")
    assert resumed >= count // 5


def run(
    outputs: Path, wanted: Sequence[str], *, threads: int, seconds: float | None = None
) -> tuple[int | None, str, float]:
    """Run the command, and kill it once it has used so many seconds of processors, which a busy machine only delays.

    Its exit code, None if it was killed, what it said, and the seconds that it used.
    """
    job = start(*SMALL, *wanted, f"threads={threads}", f"paths.outputs={outputs}", module="romgrl")
    used = [0.0]

    def ended() -> bool:
        used.append(max(used[-1], processor_seconds(job.pid)))
        return job.poll() is not None or (seconds is not None and used[-1] >= seconds)

    wait_until(ended, every=0.1)
    killed = job.poll() is None
    if killed:
        os.kill(job.pid, signal.SIGKILL)
    out, err = job.communicate(timeout=PATIENCE)
    return None if killed else job.returncode, out + err, used[-1]


def processor_seconds(process: int) -> float:
    """What a process and its workers have used."""
    total = 0.0
    with suppress(psutil.Error):
        job = psutil.Process(process)
        for each in [job, *job.children(recursive=True)]:
            with suppress(psutil.Error):
                times = each.cpu_times()
                total += times.user + times.system
    return total


def digests(outputs: Path, stages: Sequence[str]) -> dict[str, str]:
    """The digest of the artifact of every stage, one of each; a report says how long each stage took."""
    found = {stage: list((outputs / "artifacts" / stage).glob("*/manifest.json")) for stage in stages}
    assert {len(manifests) for manifests in found.values()} == {1}, found
    made = {stage: open_artifact(manifests[0].parent, stage=stage).digest for stage, manifests in found.items()}
    return {stage: digest for stage, digest in made.items() if stage != "report"}
