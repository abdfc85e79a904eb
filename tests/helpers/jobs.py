"""Jobs as processes of their own, and what their fake stages wrote down."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIGHT = ROOT / "tests" / "helpers" / "light"  # a torch that takes no time to import, for stages that do not use it
REAL_TORCH = {"PYTHONPATH": str(ROOT), "FAKE_TORCH": "real"}  # variables of a job whose fake stages say torch's threads
FAKES = ("tests.helpers.fake_stages", "tests.helpers.fake_jobs")
TWO = ("experiment=smoke", "threads=2")  # stages side by side
Command = Callable[..., "subprocess.CompletedProcess[str]"]


def start(*arguments: str, module: str = FAKES[0], **variables: str) -> subprocess.Popen[str]:
    """Start the command line in a process of its own, which has the real torch with PYTHONPATH=ROOT only."""
    path = f"{LIGHT}:{ROOT}" if module in FAKES else str(ROOT)
    environment = os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"} | variables
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env=environment,
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )


def trainings(outputs: Path) -> list[str]:
    """What the fake stages wrote down, without order."""
    return sorted((outputs / "artifacts" / "calls.txt").read_text(encoding="utf-8").splitlines())


def children(process: int) -> list[int]:
    """Process ids of the workers of a job."""
    listed = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(process)], capture_output=True, text=True, encoding="utf-8"
    )
    return [int(line.split()[0]) for line in listed.stdout.splitlines() if "romgrl.pipeline.worker" in line]
