"""Command line: python -m romgrl [key=value ...], or romgrl after installation."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from romgrl.config.schema import Config


def main() -> None:
    """Run. Until all is imported, which takes a moment, Ctrl-C ends the process without a word."""
    answer = signal.signal(signal.SIGINT, signal.SIG_DFL)
    from romgrl.cli.command import run

    signal.signal(signal.SIGINT, answer)
    run(job)


def job(config: Config, overrides: Sequence[str]) -> float | None:
    """Run a job; what it needs is imported when there is one."""
    from romgrl.sweeps.launch import run_job

    return run_job(config, overrides)


if __name__ == "__main__":
    main()
