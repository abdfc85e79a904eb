"""How long a process of a test may take: one home, so that a busy machine passes. Nothing is measured by it."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE = 600.0
"""Seconds until a test gives up on what must happen; a hundred times what it takes on an idle machine."""

LONG = str(2 * PATIENCE)
"""FAKE_SECONDS of a stage that must still run when something happens to it."""

SLACK = 15.0
"""Seconds that a busy machine may add to a wait whose length is promised."""


def wait_until(condition: Callable[[], object], *, every: float = 0.02) -> None:
    """Wait for a condition to become true; it is looked at `every` so many seconds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(every)
