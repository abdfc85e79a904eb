"""Signals that end a job: a training stops where its state is whole, everything else at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR2, signal.SIGHUP)
"""Ctrl-C, a scheduler's end, a scheduler's warning, a closed terminal; without the last where nohup has it ignored."""
if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    SIGNALS = SIGNALS[:-1]

_deferring = _counting = _once = False
_pending: signal.Signals | None = None
_count = 0
_left: set[signal.Signals] = set()
_previous: dict[signal.Signals, Callable[[int, FrameType | None], object]] = {}  # handlers of a launcher


class Interrupted(KeyboardInterrupt):
    """A signal asked for the end; the exit code is 128 + its number, as in a shell."""

    def __init__(self, number: signal.Signals) -> None:
        super().__init__(number)
        self.number = number

    @property
    def exit_code(self) -> int:
        """130 for SIGINT, 143 for SIGTERM, 140 for SIGUSR2 and 129 for SIGHUP on Linux."""
        return 128 + self.number

    def __str__(self) -> str:
        return f"interrupted by {self.number.name}"


def listen(*, once: bool = False) -> None:
    """Answer all SIGNALS from now on, also where a shell started the job in the background. Main thread only.

    `once`: only the first signal counts, so that nothing interrupts what it started.
    """
    global _pending, _once, _count
    _pending, _once, _count = None, once, 0
    if threading.current_thread() is threading.main_thread():
        for number in set(SIGNALS) - _left:
            handler = signal.signal(number, _answer)
            if callable(handler) and handler not in (_answer, signal.default_int_handler):
                _previous[number] = handler


def leave(number: signal.Signals) -> None:
    """Do not answer a signal from the next `listen` on."""
    _left.add(number)


def rest() -> None:
    """Ignore all SIGNALS until the next `listen`."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def hand_over(interrupted: Interrupted) -> None:
    """Call the handler that a launcher had put on the signal, now that all is saved.

    A launcher that starts the job again raises SystemExit; without one, nothing happens.
    """
    handler = _previous.get(interrupted.number)
    if handler is not None:
        handler(interrupted.number, None)


@contextmanager
def deferred() -> Iterator[None]:
    """Keep the first signal back while the block runs, for `check` to raise; a second one does not wait for it."""
    global _deferring
    _deferring = True
    try:
        yield
    finally:
        _deferring = False


@contextmanager
def counted() -> Iterator[None]:
    """Raise for no signal while the block runs, which looks at `count`: for a thread that shares locks with others.

    Python raises between any two instructions, also where a lock is held that nobody would free then.
    """
    global _counting
    _counting = True
    try:
        yield
    finally:
        _counting = False


def count() -> int:
    """How many signals have come."""
    return _count


def pending() -> bool:
    """Tell whether a signal has come."""
    return _pending is not None


def raise_pending() -> None:
    """Raise Interrupted if a signal has come and was kept back."""
    if _pending is not None:
        raise Interrupted(_pending)


def _answer(number: int, frame: FrameType | None) -> None:
    """The handler: raise, or remember the first signal while it is kept back."""
    global _pending, _count
    first, _pending, _count = _pending is None, _pending or signal.Signals(number), _count + 1
    if _counting or (not first and _once) or (first and _deferring):
        return
    raise Interrupted(_pending)
