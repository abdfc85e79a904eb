"""Peers in environments of their own: each is a process that measures one chunk of work whenever it is asked."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

from benchmarks import USERS_ENVIRONMENT
from benchmarks.measure import Unavailable

HERE = Path(__file__).resolve().parent
ENVIRONMENTS = HERE.parent / ".peers"


def interpreter(environment: str) -> Path:
    """Python of a peer's environment, as `make peers` builds it."""
    python = ENVIRONMENTS / environment / "bin" / "python"
    if not (python.parents[1] / ".built").exists():
        raise Unavailable(f"no environment for this peer: make {python.parents[1].relative_to(HERE.parents[1])}/.built")
    return python


class Peer:
    """A script of this directory in a peer's environment; use as a context manager."""

    def __init__(self, environment: str, script: str, *, threads: int, **settings: Any) -> None:
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed with the peer
        variables = {"OMP_NUM_THREADS": str(threads), "CUDA_VISIBLE_DEVICES": "", "PYTHONPATH": str(HERE.parents[1])}
        self._process = subprocess.Popen(
            [interpreter(environment), HERE / script, json.dumps({"threads": threads, **settings})],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env=USERS_ENVIRONMENT | variables,
            cwd=tempfile.gettempdir(),
            text=True,
            encoding="utf-8",
        )
        self.settings: dict[str, Any] = self._answer()

    def measure(self) -> float:
        """Let the peer do one chunk of its work; what it measured of it."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return float(self._answer())

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._process.wait()
            self._errors.seek(0)
            last = self._errors.read().strip().splitlines()[-1:]
            raise RuntimeError(f"the peer stopped: {' '.join(last) or 'without a word'}")
        return json.loads(line)

    def __enter__(self) -> Peer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()
        self._errors.close()
