"""kill -9 at any moment, over all stages of a real pipeline: the same command goes on and ends with the same bits."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from romgrl.artifacts import open_artifact
from romgrl.config import STAGES
from tests.pipeline.conftest import start

KILLS, EACH = 50, 10
SMALL = (
    "experiment=smoke",
    "tracking=none",
    "checkpoint_seconds=0.2",
    "teacher.total_steps=60_000",
    "student.total_steps=6000",
    "evaluation.video=false",
)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_kill_at_any_moment(tmp_path: Path) -> None:
    """One pipeline after the other, on one thread and on two, each killed again and again until it has ended."""
    generator = random.Random(0)
    begin = time.monotonic()
    code, _ = run(tmp_path / "whole", threads=1, seconds=300)
    whole = time.monotonic() - begin
    assert code == 0
    expected, kills, pipelines, resumed = digests(tmp_path / "whole"), 0, 0, 0
    while kills < KILLS:
        outputs = tmp_path / f"{pipelines}"
        code, until = None, kills + EACH
        while code is None:
            left = generator.uniform(0.1, 0.4) * whole if kills < min(until, KILLS) else 300
            resumed += any(outputs.glob("artifacts/*/*.partial/checkpoint/*.json"))
            code, text = run(outputs, threads=1 + pipelines % 2, seconds=left)
            kills += code is None
            print(f"{kills} kills, exit code {code}", flush=True)
        assert code == 0, text
        assert digests(outputs) == expected
        assert not [path for path in (outputs / "artifacts").glob("*/*") if path.suffix in (".partial", ".checkpoint")]
        pipelines += 1
        shutil.rmtree(outputs)
    print(f"{kills} kills in {pipelines} pipelines, all ended with the same bits; {resumed} times a training went on")
    assert resumed >= KILLS // 5


def run(outputs: Path, *, threads: int, seconds: float) -> tuple[int | None, str]:
    """Run the command, and kill it after some seconds; its exit code, None if it was killed, and what it said."""
    job = start(*SMALL, f"threads={threads}", f"paths.outputs={outputs}", module="romgrl")
    try:
        out, err = job.communicate(timeout=seconds)
        return job.returncode, out + err
    except subprocess.TimeoutExpired:
        os.kill(job.pid, signal.SIGKILL)
        out, err = job.communicate(timeout=20)
        return None, out + err


def digests(outputs: Path) -> dict[str, str]:
    """The digest of the artifact of every stage, one of each; a report says how long each stage took."""
    found = {stage: list((outputs / "artifacts" / stage).glob("*/manifest.json")) for stage in STAGES}
    assert {len(manifests) for manifests in found.values()} == {1}, found
    made = {stage: open_artifact(manifests[0].parent, stage=stage).digest for stage, manifests in found.items()}
    return {stage: digest for stage, digest in made.items() if stage != "report"}
