"""A little of `make test-sanitizers`: its recipe builds the core, and the core passes some tests in it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.jobs import ROOT

BIN = Path(sys.prefix, "bin")
SOME = "tests/faults/test_core_calls.py tests/rom/test_batch.py"


@pytest.mark.slow
@pytest.mark.skipif("ROMGRL_SANITIZED" in os.environ, reason="runs in it")
@pytest.mark.skipif(not (BIN / "cmake").exists(), reason="the development environment has no CMake of its own")
def test_the_core_passes_with_sanitizers(tmp_path: Path) -> None:
    """By the recipe of the Makefile, which takes the environment as it is."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "MAKE"))}
    goal = [
        "make",
        "--old-file",
        f"{sys.prefix}/.package",
        "test-sanitizers",
        f"VENV={sys.prefix}",
        f"CORE_TESTS={SOME}",
    ]
    options = f"ARGS=-n 0 -p no:cacheprovider --basetemp={tmp_path}/sanitized"
    made = subprocess.run(
        [*goal, options], cwd=ROOT, env=environment, capture_output=True, text=True, check=False, encoding="utf-8"
    )
    assert made.returncode == 0, made.stdout[-5000:] + made.stderr[-5000:]
    (passed,) = re.findall(r"(\d+) passed", made.stdout)
    assert int(passed) > 20
