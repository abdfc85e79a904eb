"""Calls to the operating system that fail on demand, one at a time, and the record of those that did not."""

from __future__ import annotations

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CALLS = ("open", "fsync", "close", "rename", "replace", "mkdir", "scandir", "listdir")  # of os; unlink only cleans up
METHODS = ("read", "readinto", "write", "flush", "close")  # of open files


WRITING = frozenset({"fsync", "rename", "replace", "mkdir", "write"})


class Faults:
    """Counts calls; the one with the number `fail` ends in an OSError, a write after half of its bytes.

    `lasting`: only WRITING counts, and all of it fails from that call on, as on a disk that stays full.
    """

    def __init__(self, fail: int | None = None, code: int = errno.EIO, *, lasting: bool = False) -> None:
        self.fail, self.code, self.lasting, self.counted = fail, code, lasting, 0
        self.calls: list[tuple[str, Any]] = []
        self.synced: list[tuple[int, int]] = []  # call number and inode
        self._open_os = os.open

    def count(self, name: str, subject: Any) -> None:
        """Write a call down, or fail it."""
        self.calls.append((name, subject))
        if self.lasting and name not in WRITING:
            return
        self.counted += 1
        if self.fail is not None and (self.counted - 1 == self.fail or (self.lasting and self.counted > self.fail)):
            raise OSError(self.code, os.strerror(self.code))

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Take the place of the operating system while the block runs."""
        with pytest.MonkeyPatch.context() as patch:
            for name in CALLS:
                patch.setattr(os, name, self._wrap(name, getattr(os, name)))
            patch.setattr(io, "open", self._wrap_open(io.open))
            patch.setattr(builtins, "open", io.open)
            yield

    def _wrap(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(subject: Any, *arguments: Any, **keywords: Any) -> Any:
            inode = os.fstat(subject).st_ino if name == "fsync" else None
            try:
                self.count(name, subject)
            except OSError:
                if name == "close":
                    call(subject)  # as the kernel does: the descriptor is gone, whatever it says
                raise
            if inode is not None:
                self.synced.append((len(self.calls) - 1, inode))
            return call(subject, *arguments, **keywords)

        return counted

    def _wrap_open(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(file: Any, *arguments: Any, **keywords: Any) -> Any:
            self.count("open", file)
            opened = call(file, *arguments, **keywords)
            return CountedFile(opened, self) if not isinstance(file, int) else opened

        return counted


class CountedFile:
    """An open file whose methods are counted."""

    def __init__(self, file: Any, faults: Faults) -> None:
        self._file, self._faults = file, faults

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._file, name)
        if name not in METHODS:
            return method

        def counted(*arguments: Any) -> Any:
            try:
                self._faults.count(name, self._file.name)
            except OSError:
                if name == "write":
                    method(arguments[0][: len(arguments[0]) // 2])
                if name == "close":
                    method()
                raise
            return method(*arguments)

        return counted

    def __enter__(self) -> CountedFile:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Any]:
        return iter(self._file)
