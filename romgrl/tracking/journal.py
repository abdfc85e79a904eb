"""What a job has to tell MLflow, written down before it is sent: one file of JSON lines for each recording process.

The pipeline appends and the process of MLflow reads from behind, so neither waits for the other, and what was written
survives the end of both. Beside each file lies how far the store has it; with the last line, both go.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import threading
import time
import uuid
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

FIELDS = {
    "start": {"name", "parent", "tags", "params", "run_id"},
    "tags": {"tags"},
    "metrics": {"values", "step"},
    "artifacts": {"directory"},
    "finish": {"status"},
}  # of each request, beside `do`, `run` (its local id) and `at` (milliseconds since 1970)
SYNC_SECONDS = 1.0  # of requests that a power failure may take
READ_BYTES = 65536  # read and sent before it is noted that the store has it
MARK_BYTES, LONGEST_PLACE = 20, 4096  # of a `.sent` file: how far the store has the journal, and which store that is
PASSWORD = re.compile(r"(://[^\s:/@]*:)\S*@")
HIDDEN = "***"

Entry = dict[str, Any]


def redacted(text: str) -> str:
    """Hide the password of every address in a text."""
    return PASSWORD.sub(rf"\1{HIDDEN}@", text)


def journal_directory(outputs: Path) -> Path:
    """Where the journals of an output directory are."""
    return outputs / "journal"


def journals(outputs: Path) -> list[Path]:
    """All journals, the oldest first."""
    return sorted(journal_directory(outputs).glob("*.jsonl"))


def starts_run(directory: Path, uid: str, among: str = "*.jsonl") -> bool:
    """Tell whether a journal has the start of a run, sent or not; `among="*.left"`: whether it was set aside."""
    marks = (f'"run": "{uid}"'.encode(), b'"do": "start"')
    for path in directory.glob(among):
        with suppress(FileNotFoundError), path.open("rb") as lines:
            if any(all(mark in line for mark in marks) for line in lines):
                return True
    return False


class JournalError(Exception):
    """A journal that cannot be read."""


class BusyError(Exception):
    """Another process sends a journal, or has just done so."""


class Journal:
    """The side that writes; the file stays locked while the job lives."""

    def __init__(self, outputs: Path, header: Entry) -> None:
        directory = journal_directory(outputs)
        directory.mkdir(parents=True, exist_ok=True)
        self.path = directory / f"{time.time_ns() // 1000:020d}-{uuid.uuid4().hex[:8]}.jsonl"
        hidden = self.path.with_suffix(".new")  # nobody finds it before it is locked and has its header
        self._file = os.open(hidden, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o666)
        fcntl.flock(self._file, fcntl.LOCK_EX)
        self._writing = threading.Lock()
        self._synced = self._size = 0
        self._closing = threading.Event()
        self.append(header)
        os.replace(hidden, self.path)
        threading.Thread(target=self._sync_until_closed, name="journal", daemon=True).start()

    def append(self, entry: Entry) -> None:
        """Add one line, whole or not at all. Raises OSError."""
        line = json.dumps(entry).encode() + b"\n"
        with self._writing:
            if self._closing.is_set():
                raise OSError("closed")
            try:
                if os.write(self._file, line) < len(line):
                    raise OSError("the disk is full")
            except OSError:
                os.ftruncate(self._file, self._size)
                raise
            self._size += len(line)

    def sync(self) -> None:
        """Bring what was written to the disk itself."""
        if self._synced < self._size:
            self._synced = self._size
            os.fsync(self._file)

    def close(self) -> None:
        """The job has no more to say."""
        if not self._closing.is_set():
            self._closing.set()
            with self._writing, suppress(OSError):
                self.sync()
                os.close(self._file)

    def _sync_until_closed(self) -> None:
        while not self._closing.wait(SYNC_SECONDS):
            with suppress(OSError):  # the next try, or the next line, tells
                self.sync()


class Outbox:
    """The side that sends, one process at a time. Raises BusyError or JournalError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._state_path = path.with_suffix(".sent")
        self.left_path, self.refused_path = path.with_suffix(".left"), path.with_suffix(".refused")
        try:
            self._state = os.open(self._state_path, os.O_RDWR | os.O_CREAT, 0o666)
        except PermissionError as error:  # another user's
            raise JournalError(f"{self._state_path}: {error.strerror}; whose it is may send it") from None
        try:
            fcntl.flock(self._state, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._lines = path.open("rb")
        except FileNotFoundError:
            self._state_path.unlink(missing_ok=True)
            os.close(self._state)
            raise BusyError("is sent") from None
        except OSError:
            os.close(self._state)
            raise BusyError("is being sent by another process") from None
        header = parsed(self._lines.readline(), set())
        if header is None or not {"uri", "experiment"} <= header.keys():
            self.close()
            raise JournalError(f"{path}: the first line is not a header")
        self.uri: str | None = header["uri"]
        self.experiment: str = header["experiment"]
        self._first = self._lines.tell()
        self.unreadable = 0
        self._beside: dict[Path, set[str]] = {}  # lines of the files beside it

    @property
    def offset(self) -> int:
        """Bytes that the store has."""
        noted = os.pread(self._state, MARK_BYTES, 0)
        return max(int(noted), self._first) if noted.isdigit() else self._first

    def mark(self, offset: int) -> None:
        """The store has everything up to here."""
        os.pwrite(self._state, b"%020d" % offset, 0)

    def read(self, start: int | None = None) -> tuple[list[Entry], int]:
        """The next requests and where they end; artifacts, which may be large, end a piece. A torn line waits."""
        entries: list[Entry] = []
        begin = end = self.offset if start is None else start
        self._lines.seek(begin)
        for line in self._lines:
            if not line.endswith(b"\n"):
                break
            end += len(line)
            entry = parsed(line, {"run", "do", "at"})
            if entry is None:
                self.unreadable += 1
            else:
                entries.append(entry)
            if end - begin >= READ_BYTES or (entry and entry["do"] == "artifacts"):
                break
        return entries, end

    def sent(self) -> list[Entry]:
        """What the store has had before."""
        entries: list[Entry] = []
        end = self._first
        while end < self.offset:
            piece, end = self.read(end)
            entries += piece
        return entries

    def job_ended(self) -> bool:
        """Tell whether nobody writes any more: the system frees the lock of a process that dies."""
        try:
            fcntl.flock(self._lines, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return False
        fcntl.flock(self._lines, fcntl.LOCK_UN)
        return True

    def left(self) -> list[Entry]:
        """Requests that were set aside, to be sent once somebody has mended what keeps the store from taking them."""
        return kept(self.left_path)

    def keep_left(self, entries: Sequence[Entry]) -> None:
        """Keep these requests and no others for later."""
        self._beside.pop(self.left_path, None)
        if not entries:
            self.left_path.unlink(missing_ok=True)
            return
        written = self.left_path.with_suffix(".left-new")
        written.write_text("".join(json.dumps(entry) + "\n" for entry in entries), encoding="utf-8")
        os.replace(written, self.left_path)

    def set_aside(self, entry: Entry) -> None:
        """Keep a request for later."""
        self._append_once(self.left_path, entry)

    def refuse(self, entry: Entry) -> None:
        """Keep a request that is not sent any more, beside the journal and after it."""
        self._append_once(self.refused_path, entry)

    def aim(self, place: str = "") -> None:
        """Send to a place, the one that was meant or another; one that differs from the last gets the whole journal."""
        if os.pread(self._state, LONGEST_PLACE, MARK_BYTES) != place.encode()[:LONGEST_PLACE]:
            os.ftruncate(self._state, 0)
            self.keep_left([])
            os.pwrite(self._state, place.encode()[:LONGEST_PLACE], MARK_BYTES)

    def _append_once(self, path: Path, entry: Entry) -> None:
        line = json.dumps(entry)
        if path not in self._beside:
            self._beside[path] = set(path.read_text(encoding="utf-8").splitlines()) if path.exists() else set()
        if line not in self._beside[path]:
            self._beside[path].add(line)
            with path.open("a", encoding="utf-8") as lines:
                lines.write(line + "\n")

    def delete(self) -> None:
        """The store has everything."""
        self.path.unlink(missing_ok=True)
        self.left_path.unlink(missing_ok=True)
        self._state_path.unlink(missing_ok=True)

    def close(self) -> None:
        """Let another process send."""
        self._lines.close()
        os.close(self._state)


def kept(path: Path) -> list[Entry]:
    """The requests in a file beside a journal."""
    lines = path.read_bytes().splitlines() if path.exists() else []
    return [entry for line in lines if (entry := parsed(line, {"run", "do", "at"})) is not None]


def parsed(line: bytes, names: set[str]) -> Entry | None:
    """The request on a line, or the header where no `names` are asked for; None for what cannot be read."""
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    if not isinstance(entry, dict) or not names <= entry.keys():
        return None
    whole = not names or (str(entry["do"]) in FIELDS and FIELDS[entry["do"]] <= entry.keys())
    return entry if whole else None
