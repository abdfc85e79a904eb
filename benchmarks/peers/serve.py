"""The peer's end of the line: say what it is, then measure one chunk of work for every line that comes in."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any

settings: dict[str, Any] = json.loads(sys.argv[1]) if len(sys.argv) > 1 else {}
_line = os.fdopen(os.dup(1), "w", encoding="utf-8")
os.dup2(2, 1)  # what the peer prints shall not come between the answers


def answer(value: object) -> None:
    """Send one answer."""
    print(json.dumps(value), file=_line, flush=True)


def wait() -> None:
    """Wait until the next chunk is asked for; the other side closes the line when it has enough."""
    if not sys.stdin.readline():
        os._exit(0)


def serve(about: dict[str, Any], chunk: Callable[[], float]) -> None:
    """Answer until the line closes; `chunk` does a piece of work and says what it measured."""
    answer(about)
    while True:
        wait()
        answer(chunk())
