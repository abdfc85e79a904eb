"""What a worker asks of torch before a stage; fake stages draw nothing, and torch itself takes seconds to import."""

from __future__ import annotations

_threads = 0


class cuda:
    """No device."""

    @staticmethod
    def is_available() -> bool:
        """False."""
        return False


def manual_seed(seed: int) -> None:
    """Seed nothing."""


def set_num_threads(threads: int) -> None:
    """Note the number, which a fake stage writes down."""
    global _threads
    _threads = threads


def get_num_threads() -> int:
    """The number that was noted."""
    return _threads


def set_flush_denormal(flush: bool) -> None:
    """Flush nothing."""
