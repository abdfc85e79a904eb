"""The lines of a journal on the disk: torn ones, full disks, what a line costs and what is in none."""

from __future__ import annotations

import errno
import json
import os
import statistics
import time
from contextlib import closing
from pathlib import Path

import pytest

from romgrl.tracking import journal
from romgrl.tracking.journal import JournalError, Outbox, redacted
from romgrl.tracking.recorder import Recorder, default_uri
from tests.faults.journals import journaled
from tests.helpers.limits import wait_until

HEADER = {"uri": None, "experiment": "romgrl"}


def test_a_torn_line_waits_and_a_broken_one_is_counted(tmp_path: Path) -> None:
    recorder, written = journaled(tmp_path)
    run = recorder.start("x", tags={})
    run.metrics({"m": 1.0}, 1)
    whole = written.path.stat().st_size
    with written.path.open("ab") as file:
        file.write(b'{"run": "1", "do": "metrics"')
    with closing(Outbox(written.path)) as outbox:
        entries, end = outbox.read()
        assert ([entry["do"] for entry in entries], end) == (["start", "metrics"], whole)
        with written.path.open("ab") as file:
            file.write(b'\x00\n["list"]\n{"do": "jump", "run": 1, "at": 1}\n{"do": "tags", "run": 1, "at": 1}\n{\n')
        run.finish()
        entries, _ = outbox.read()
        assert ([entry["do"] for entry in entries], outbox.unreadable) == (["start", "metrics", "finish"], 5)
    for damaged in (b"", b"{", b"[]\n", b'{"uri": null}\n'):
        bad = written.path.with_name("bad.jsonl")
        bad.write_bytes(damaged)
        with pytest.raises(JournalError, match=r"bad\.jsonl: the first line is not a header"):
            Outbox(bad)


def test_a_full_disk_leaves_whole_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recorder, written = journaled(tmp_path)
    run = recorder.start("x", tags={})
    write = os.write

    def half(file: int, line: bytes) -> int:
        return write(file, line[: len(line) // 2])

    def none(file: int, line: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for full in (half, none):
        monkeypatch.setattr(os, "write", full)
        run.metrics({"m": 1.0}, 1)
        monkeypatch.setattr(os, "write", write)
        run.metrics({"m": 2.0}, 2)
    lines = [json.loads(line) for line in written.path.read_text(encoding="utf-8").splitlines()]
    assert [line.get("do") for line in lines] == [None, "start", "metrics", "metrics"]
    errors = capsys.readouterr().err
    assert errors.count("warning: not everything goes to MLflow: ") == 1
    assert str(written.path) in errors


def test_nothing_is_written_after_the_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The number of the closed file may be another file's by then."""
    recorder, written = journaled(tmp_path)
    run = recorder.start("x", tags={})
    written.close()
    with (tmp_path / "other").open("wb") as other:
        assert other.fileno() == written._file
        run.metrics({"m": 1.0}, 1)
    assert (tmp_path / "other").read_bytes() == b""
    assert capsys.readouterr().err.count("not everything goes to MLflow") == 1


def test_written_lines_come_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(journal, "SYNC_SECONDS", 0.05)
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_size))
    recorder, written = journaled(tmp_path)
    recorder.start("x", tags={})
    wait_until(lambda: synced and synced[-1] >= written.path.stat().st_size)
    recorder.start("y", tags={})
    written.close()
    assert synced[-1] == written.path.stat().st_size


def test_a_directory_that_cannot_be_written_costs_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "journal").write_text("in the way", encoding="utf-8")
    recorder = Recorder(default_uri(tmp_path), "romgrl", tmp_path)
    run = recorder.start("x", tags={})
    run.metrics({"m": 1.0}, 1)
    run.finish()
    assert run.run_id is None
    recorder.close()
    assert capsys.readouterr().err.count("warning: nothing goes to MLflow: ") == 1


def test_a_log_call_costs_far_less_than_a_millisecond(tmp_path: Path) -> None:
    recorder, written = journaled(tmp_path)
    run = recorder.start("x", tags={})
    seconds = []
    for step in range(2000):
        before = time.perf_counter()
        run.metrics({f"m{i}": float(step) for i in range(20)}, step)
        seconds.append(time.perf_counter() - before)
    written.close()
    print(f"a call with 20 numbers: {1e6 * statistics.median(seconds):.0f} us")
    assert statistics.median(seconds) < 0.0005


def test_passwords_are_written_nowhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for password in ("se@cret", "se%40cret"):
        told = f"speed=1 tracking.uri=postgresql://ann:{password}@localhost:1/runs x"
        assert redacted(told) == "speed=1 tracking.uri=postgresql://ann:***@localhost:1/runs x"
    uri = "postgresql+psycopg://ann:se%40cret@localhost:1/runs"
    assert redacted("http://127.0.0.1:5000 sqlite:////a/b.db a@b:c") == "http://127.0.0.1:5000 sqlite:////a/b.db a@b:c"
    recorder = Recorder(uri, "romgrl", tmp_path)
    run = recorder.start(f"tracking.uri={uri}", tags={}, params={"tracking": {"uri": uri}})
    assert run.run_id == run.local_id
    run.finish()
    recorder.close()
    output = capsys.readouterr()
    files = [path.read_text(encoding="utf-8") for path in journal.journal_directory(tmp_path).iterdir()]
    assert "postgresql+psycopg://ann:***@" in output.err
    assert sum("postgresql+psycopg://ann:***@" in text for text in files) >= 1
    assert not any("cret" in text for text in (output.out, output.err, *files))
