"""How a run ended that did not end well: interrupted, a job of a sweep was lost, or its tables could not be made."""

from __future__ import annotations

import signal
import sys
from concurrent.futures import BrokenExecutor

from romgrl.errors import LaunchError, RomgrlError


def exit_code_of(error: KeyboardInterrupt | RuntimeError | RomgrlError) -> int:
    """The exit code of an interruption, or of a fault, which is told on one line. Raises what is a bug again."""
    if isinstance(error, RomgrlError):
        print(error, file=sys.stderr)
        return error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return int(getattr(error, "exit_code", 128 + signal.SIGINT))
    submitit = sys.modules.get("submitit.core.utils")
    lost = (BrokenExecutor,) if submitit is None else (submitit.UncompletedJobError, submitit.FailedSubmissionError)
    if not isinstance(error, lost) or (submitit is not None and isinstance(error, submitit.FailedJobError)):
        raise error
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    print(f"a job of the sweep was lost: {reason}", file=sys.stderr)
    return LaunchError.exit_code
