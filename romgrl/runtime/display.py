"""Standard output and error: what is said there may be lost, but the work goes on, whatever becomes of the terminal."""

from __future__ import annotations

import errno
import io
import os
import select
import sys
from contextlib import suppress
from typing import Any, TextIO

STDERR = 2
PATIENCE_MILLISECONDS = 10_000  # with a reader that has stopped, as Ctrl-S does
PIECE_BYTES = 512  # that a pipe takes at once where it says that there is room
STREAMS = {1: "stdout", STDERR: "stderr"}
ENCODING_ERRORS = {1: "replace", STDERR: "backslashreplace"}  # what becomes of letters that a terminal does not have


def protect() -> None:
    """Let no print of this process raise from now on; the first thing that an entry point does.

    A stream that somebody has put in the place of the process's own, as tests do, stays.
    """
    missing = [descriptor for descriptor in (0, *STREAMS) if is_closed(descriptor)]
    for descriptor in missing:
        discard(descriptor)  # or the next file to be opened would get it, and with it what children print
    for descriptor, name in STREAMS.items():
        stream = getattr(sys, name)
        if stream is getattr(sys, f"__{name}__") and not isinstance(getattr(stream, "buffer", None), Guarded):
            guarded = guard_stream(stream, Guarded(descriptor, reachable=stream is not None or descriptor in missing))
            setattr(sys, name, guarded)
            setattr(sys, f"__{name}__", guarded)


def is_closed(descriptor: int) -> bool:
    """Tell whether a descriptor is free for the next file."""
    try:
        os.fstat(descriptor)
    except OSError:
        return True
    return False


def discard(descriptor: int) -> None:
    """Lose what is written to a descriptor from now on, also by the processes that inherit it."""
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, descriptor)
    os.set_inheritable(descriptor, True)
    if null != descriptor:
        os.close(null)


def without_waiting(terminal: int) -> int:
    """The same terminal, opened so that no write waits: one that has room for a little may keep the rest waiting."""
    try:
        return os.open(os.ttyname(terminal), os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    except OSError:
        return terminal


def guard_stream(stream: TextIO | None, raw: Guarded) -> TextIO:
    """A text stream that never fails, with the encoding and the buffering of another; None: there was none."""
    if stream is None:
        raw.lose("is closed")
    else:
        with suppress(OSError, ValueError):
            stream.flush()
    return io.TextIOWrapper(
        raw,
        encoding=getattr(stream, "encoding", "utf-8"),
        errors=ENCODING_ERRORS[raw.descriptor],
        line_buffering=getattr(stream, "line_buffering", True),
        write_through=getattr(stream, "write_through", False),
    )


class Guarded(io.RawIOBase):
    """Writes to stdout or stderr, and drops what that refuses; the first time, standard error is told.

    Not `reachable`: its descriptor is another file by now, which it does not touch.
    """

    def __init__(self, descriptor: int, *, reachable: bool = True) -> None:
        self.descriptor = descriptor
        self.name = f"<{STREAMS[descriptor]}>"
        self._reachable = reachable
        self._told = False
        self._target = without_waiting(descriptor) if self.isatty() else descriptor

    def fileno(self) -> int:
        """The descriptor."""
        return self.descriptor

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""
        return self._reachable and os.isatty(self.descriptor)

    def writable(self) -> bool:
        """It is, in any case."""
        return True

    def write(self, data: Any, /) -> int:
        """Write all of it or lose the rest."""
        rest = memoryview(data)
        try:
            while rest and self._reachable:
                rest = rest[self._write_some(rest) :]
        except OSError as error:
            if error.errno == errno.EPIPE:
                with suppress(OSError):
                    discard(self.descriptor)  # the signal that comes with it would end ffmpeg, which inherits it
            self.lose(error.strerror or os.strerror(errno.EIO))
        return len(data)

    def lose(self, reason: str) -> None:
        """Tell once, where it can be told, why nothing is shown any more."""
        if not self._told and self.descriptor != STDERR:
            line = f"romgrl: {STREAMS[self.descriptor]}: {reason}; the work goes on, what it would say is lost\n"
            with suppress(OSError):
                os.write(STDERR, line.encode())
        self._told = True

    def _write_some(self, data: memoryview) -> int:
        """Write a piece that fits, once it does. A reader that stands still is waited for once, and then passed by."""
        room = select.poll()
        room.register(self._target, select.POLLOUT)
        if not room.poll(0 if self._told else PATIENCE_MILLISECONDS):
            raise TimeoutError(errno.ETIMEDOUT, "nobody reads it")
        with suppress(BlockingIOError):  # another process may have set the descriptor not to wait
            return os.write(self._target, data[:PIECE_BYTES])
        return 0
