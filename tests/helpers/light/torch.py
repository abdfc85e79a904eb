"""What a worker asks of torch before a stage; fake stages draw nothing, and torch itself takes seconds to import."""

from __future__ import annotations


class cuda:
    """No device."""

    @staticmethod
    def is_available() -> bool:
        """False."""
        return False


def manual_seed(seed: int) -> None:
    """Seed nothing."""


def set_num_threads(threads: int) -> None:
    """There are none."""


def set_flush_denormal(flush: bool) -> None:
    """Flush nothing."""
