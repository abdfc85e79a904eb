"""One process at a time makes an artifact; the others know whom they wait for."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from romgrl.artifacts import lock_mode

LOCK_SECONDS = 0.5  # between two looks at whether to stop waiting for another process


@contextmanager
def exclusive(directory: Path, *, say: Callable[[str], None], stopping: Callable[[], bool]) -> Iterator[None]:
    """Hold the lock of an artifact while the block runs, and say whom it was waited for or taken over from.

    The operating system frees the lock of a process that dies. Raises KeyboardInterrupt once `stopping()` is true.
    """
    directory.parent.mkdir(parents=True, exist_ok=True)
    lock, owner = FileLock(lock_path(directory), mode=lock_mode(directory.parent)), Owner(directory)
    name = f"{directory.parent.name}: {directory.name}"
    try:
        lock.acquire(timeout=0)
    except Timeout:
        say(f"{name} is being made by {owner}; waiting for it")
        wait_for(lock, stopping)
    try:
        if owner.path.exists():
            say(f"{name} was left behind by {owner}; taken over")
        owner.sign()
        yield
    finally:
        owner.leave()
        lock.release()


def lock_path(directory: Path) -> Path:
    """The lock of an artifact."""
    return directory.with_name(f".{directory.name}.lock")


def wait_for(lock: FileLock, stopping: Callable[[], bool]) -> None:
    """Acquire a lock, or raise KeyboardInterrupt once the job is being stopped."""
    while not lock.is_locked:
        if stopping():
            raise KeyboardInterrupt
        with suppress(Timeout):
            lock.acquire(timeout=LOCK_SECONDS)


@contextmanager
def waited_for(lock: FileLock, stopping: Callable[[], bool]) -> Iterator[None]:
    """Hold a lock while the block runs. Raises KeyboardInterrupt once the job is being stopped."""
    try:
        wait_for(lock, stopping)
        yield
    finally:
        lock.release()


class Owner:
    """The process that holds the lock of an artifact, as it wrote itself down beside it."""

    def __init__(self, directory: Path) -> None:
        self.path = directory.with_name(f".{directory.name}.owner")

    def __str__(self) -> str:
        try:
            signed = json.loads(self.path.read_text(encoding="utf-8"))
            return f"process {signed['process']} on {signed['host']} since {signed['since']}"
        except (OSError, ValueError, KeyError, TypeError):
            return "another process"

    def sign(self) -> None:
        """Write down this process, in the place of another user's file as well."""
        since = datetime.now().astimezone().isoformat(timespec="seconds")
        signed = {"process": os.getpid(), "host": socket.gethostname(), "since": since}
        self.leave()
        with suppress(PermissionError):  # it only says whom to wait for
            self.path.write_text(json.dumps(signed), encoding="utf-8")

    def leave(self) -> None:
        """Nobody holds the lock any more."""
        with suppress(PermissionError):
            self.path.unlink(missing_ok=True)
