"""Every signal that a terminal or a scheduler sends leaves a checkpoint soon, and an exit code of its own."""

from __future__ import annotations

import random
import re
import resource
import signal
import time
from pathlib import Path

import psutil
import pytest

from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.runtime.signals import SIGNALS
from tests.helpers.jobs import start
from tests.helpers.limits import PATIENCE, wait_until

SECONDS = 10.0  # of a processor, from the signal to the end
LONG = {
    "teacher": "teacher.total_steps=50_000_000",
    "baseline": "student.total_steps=50_000_000",
}


@pytest.mark.parametrize("count", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_signals_leave_a_checkpoint(tmp_path: Path, count: int) -> None:
    """Interrupted again and again, each training goes on from a later step than the time before."""
    generator = random.Random(0)
    steps = dict.fromkeys(LONG, 0)
    slowest, kept = 0.0, 0
    for attempt in range(count):
        stage, number = list(LONG)[attempt // 2 % 2], SIGNALS[attempt % len(SIGNALS)]
        seconds, text = interrupt(stage, number, generator.uniform(0.0, 0.5), tmp_path / "outputs")
        slowest = max(slowest, seconds)
        if steps[stage]:
            (resumed,) = re.findall(r"goes on at step ([\d,]+)", text)
            assert int(resumed.replace(",", "")) == steps[stage]
        (reached,) = re.findall(rf"{stage}: interrupted at step ([\d,]+)", text)
        assert int(reached.replace(",", "")) > steps[stage]
        steps[stage] = int(reached.replace(",", ""))
        kept += 1
    assert slowest < SECONDS
    print(f"{kept} of {count} signals left a checkpoint, the slowest after {slowest:.1f} s of a processor")


def interrupt(stage: str, number: signal.Signals, delay: float, outputs: Path) -> tuple[float, str]:
    """Signal a training in its loop; how long it used a processor to end, and what it said."""
    arguments = ("experiment=smoke", f"stage={stage}", "tracking=none", "threads=1", f"paths.outputs={outputs}")
    job = start(*arguments, LONG[stage], module="romgrl")
    folder = outputs / "artifacts" / stage
    began = time.time()
    wait_until(lambda: any(path.stat().st_mtime > began for path in folder.glob("*.partial/curve.csv")))
    time.sleep(delay)
    before = psutil.Process(job.pid).cpu_times()
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    job.send_signal(number)
    out, err = job.communicate(timeout=PATIENCE)
    assert (job.returncode, err) == (128 + number, "")
    assert list(folder.glob(f"*.partial/{CHECKPOINT}"))
    all_ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = all_ended.ru_utime + all_ended.ru_stime - ended.ru_utime - ended.ru_stime
    return used - before.user - before.system, out
