"""Fixtures of the pipeline's tests."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from romgrl import keys
from tests.pipeline import fake_stages

ROOT = Path(__file__).resolve().parents[2]
Command = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def fakes() -> Iterator[None]:
    """Replace every stage by a fake one."""
    saved = dict(keys.STAGES)
    fake_stages.install()
    yield
    keys.STAGES.update(saved)


def start(*arguments: str, module: str = "tests.pipeline.fake_stages", **variables: str) -> subprocess.Popen[str]:
    """Start the command line in a process of its own."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"} | variables
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env=environment,
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.fixture
def command(tmp_path: Path) -> Command:
    """Run the command line with fake stages in a process of its own, outputs in the test's directory."""

    def execute(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        process = start(*arguments, f"paths.outputs={tmp_path}/outputs", **variables)
        out, err = process.communicate(timeout=120)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    return execute


def trainings(outputs: Path) -> list[str]:
    """What the fake stages wrote down, without order."""
    return sorted((outputs / "artifacts" / "calls.txt").read_text().splitlines())
