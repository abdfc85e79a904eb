"""Every signal that a terminal or a scheduler sends leaves a checkpoint within 10 s and an exit code of its own."""

from __future__ import annotations

import random
import re
import signal
import time
from pathlib import Path

import pytest

from romgrl.checkpoint import CHECKPOINT
from romgrl.interruption import SIGNALS
from tests.faults.test_locks import wait_until
from tests.pipeline.conftest import start

COUNT, SECONDS = 20, 10.0
LONG = {
    "teacher": "teacher.total_steps=50_000_000",
    "baseline": "student.total_steps=50_000_000",
}


@pytest.mark.slow
def test_signals_leave_a_checkpoint(tmp_path: Path) -> None:
    """Interrupted again and again, each training goes on from a later step than the time before."""
    generator = random.Random(0)
    steps = dict.fromkeys(LONG, 0)
    slowest, kept = 0.0, 0
    for attempt in range(COUNT):
        stage, number = list(LONG)[attempt % 2], SIGNALS[attempt // 2 % len(SIGNALS)]
        seconds, text = interrupt(stage, number, generator.uniform(0.0, 0.5), tmp_path / "outputs")
        slowest = max(slowest, seconds)
        if steps[stage]:
            (resumed,) = re.findall(r"goes on at step ([\d,]+)", text)
            assert int(resumed.replace(",", "")) == steps[stage]
        (reached,) = re.findall(rf"{stage}: interrupted at step ([\d,]+)", text)
        assert int(reached.replace(",", "")) > steps[stage]
        steps[stage] = int(reached.replace(",", ""))
        kept += 1
    print(f"{kept} of {COUNT} signals left a checkpoint, the slowest within {slowest:.1f} s")


def interrupt(stage: str, number: signal.Signals, delay: float, outputs: Path) -> tuple[float, str]:
    """Signal a training in its loop; how long it took to end, and what it said."""
    arguments = ("experiment=smoke", f"stage={stage}", "tracking=none", "threads=1", f"paths.outputs={outputs}")
    job = start(*arguments, LONG[stage], module="romgrl")
    folder = outputs / "artifacts" / stage
    began = time.time()
    wait_until(lambda: any(path.stat().st_mtime > began for path in folder.glob("*.partial/curve.csv")), seconds=60)
    time.sleep(delay)
    sent = time.monotonic()
    job.send_signal(number)
    out, err = job.communicate(timeout=SECONDS)
    assert (job.returncode, err) == (128 + number, "")
    assert list(folder.glob(f"*.partial/{CHECKPOINT}"))
    return time.monotonic() - sent, out
