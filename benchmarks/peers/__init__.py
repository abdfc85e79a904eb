"""Peers in environments of their own: each is a process that measures one chunk of work whenever it is asked."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

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
    """A running script of this directory; `settings` is what it says of itself."""

    def __init__(self, process: subprocess.Popen[str], errors: IO[str]) -> None:
        self._process, self._errors = process, errors
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


@contextmanager
def started(environment: str, script: str, *, threads: int, **settings: Any) -> Iterator[Peer]:
    """A peer's script while the block runs. Raises Unavailable where its environment is not built."""
    command = [str(interpreter(environment)), str(HERE / script), json.dumps({"threads": threads, **settings})]
    variables = {"OMP_NUM_THREADS": str(threads), "CUDA_VISIBLE_DEVICES": "", "PYTHONPATH": str(HERE.parents[1])}
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8") as errors,
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env=USERS_ENVIRONMENT | variables,
            cwd=tempfile.gettempdir(),
            text=True,
            encoding="utf-8",
        ) as process,
    ):
        try:
            yield Peer(process, errors)
        finally:
            process.kill()
