"""How a command ended that did not end well: interrupted, a job was lost, or a file could not be made."""

from __future__ import annotations

import signal
import sys
from concurrent.futures import BrokenExecutor

from romgrl.errors import LaunchError, RomgrlError, StorageError


def exit_code_of(error: KeyboardInterrupt | RuntimeError | OSError | RomgrlError) -> int:
    """The exit code of an interruption, or of a fault, which is told on one line. Raises what is a bug again.

    A file of Hydra's that cannot be made is such a fault; those of a job's own were told by its stages.
    """
    if isinstance(error, RomgrlError):
        print(error, file=sys.stderr)
        return error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return int(getattr(error, "exit_code", 128 + signal.SIGINT))
    if isinstance(error, OSError):
        if error.filename is None:
            raise error
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        return StorageError.exit_code
    submitit = sys.modules.get("submitit.core.utils")
    lost = (BrokenExecutor,) if submitit is None else (submitit.UncompletedJobError, submitit.FailedSubmissionError)
    if not isinstance(error, lost) or (submitit is not None and isinstance(error, submitit.FailedJobError)):
        raise error
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    print(f"a job of the sweep was lost: {reason}", file=sys.stderr)
    return LaunchError.exit_code
