"""The journal of what MLflow is told: every request of a sender fails in turn, lines tear, disks are full."""

from __future__ import annotations

import errno
import json
import os
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from romgrl.tracking import journal
from romgrl.tracking.journal import BusyError, Journal, JournalError, Outbox, journals, redacted
from romgrl.tracking.recorder import LOCAL, RecordedRun, Recorder, default_uri
from romgrl.tracking.sending.__main__ import own_outbox
from romgrl.tracking.sending.sender import ParentError, Sender
from romgrl.tracking.sending.store import Store
from tests.faults.runs import FILES, Told, differences, stored
from tests.helpers.limits import wait_until

HEADER = {"uri": None, "experiment": "romgrl"}


class FaultyStore(Store):
    """A store of which one request fails: before it is done, or after, so that only the answer is lost."""

    def __init__(self, outputs: Path, *, failing: int = 0, after: bool = False) -> None:
        super().__init__(default_uri(outputs), outputs)
        self.failing, self.after, self.requests = failing, after, 0

    def request(self, method: str, *arguments: Any, **named: Any) -> Any:
        self.requests += 1
        fails = self.requests == self.failing
        answer = None if fails and not self.after else super().request(method, *arguments, **named)
        if fails:
            raise OSError("lost")
        return answer


def journaled(outputs: Path, experiment: str = "romgrl") -> tuple[Recorder, Journal]:
    """A recorder with a journal and no process."""
    recorder = Recorder(default_uri(outputs), experiment, outputs, enabled=False)
    recorder.journal = Journal(outputs, {"uri": None, "experiment": experiment})
    return recorder, recorder.journal


def send_all(store: Store, outputs: Path) -> None:
    """Send every journal to its end, as one process would."""
    for path in journals(outputs):
        with closing(Outbox(path)) as outbox:
            sender = Sender(outbox, store, {})
            while sender.step():
                pass
            sender.end()


def tell(outputs: Path, experiment: str) -> Told:
    """A whole job, into a journal only."""
    recorder, written = journaled(outputs, experiment)
    told = Told(recorder, outputs / "published" / experiment)
    told.start()
    told.steps(0, 4)
    told.finish()
    written.close()
    return told


def test_every_request_fails_in_turn(outputs: Path) -> None:
    store = FaultyStore(outputs)
    tell(outputs, "calm")
    send_all(store, outputs)
    total, lost, twice, cases = store.requests, 0, 0, 0
    for failing in range(1, total + 1):
        for after in (False, True):
            experiment = f"{failing} {after}"
            told = tell(outputs, experiment)
            with pytest.raises(OSError, match="lost"):
                send_all(FaultyStore(outputs, failing=failing, after=after), outputs)
            assert len(journals(outputs)) == 1
            send_all(Store(default_uri(outputs), outputs), outputs)
            assert journals(outputs) == []
            found = differences(told, stored(outputs / "mlflow.db", experiment))
            lost, twice, cases = lost + found[0], twice + found[1], cases + 1
    print(f"{cases} requests failed, {total} before and {total} after they were done: {lost} lost, {twice} twice")
    assert (cases, lost, twice) == (2 * total, 0, 0)
    assert total >= 20


class BrokenStore(FaultyStore):
    """A store of which one answer breaks off after its first line, so that it reads as if it were empty."""

    def request(self, method: str, *arguments: Any, **named: Any) -> Any:
        answer = super().request(method, *arguments, **named)
        if method == "create_run":
            answer.info._run_id = ""
        return answer


def test_an_empty_answer_names_no_run(outputs: Path) -> None:
    told = tell(outputs, "broken")
    with pytest.raises(OSError, match="the answer broke off"):
        send_all(BrokenStore(outputs), outputs)
    send_all(Store(default_uri(outputs), outputs), outputs)
    assert differences(told, stored(outputs / "mlflow.db", "broken")) == (0, 0)


def test_what_is_marked_is_not_sent_again(outputs: Path) -> None:
    told = tell(outputs, "once")
    (path,) = journals(outputs)
    first, second = FaultyStore(outputs), FaultyStore(outputs)
    with closing(Outbox(path)) as outbox:
        sender = Sender(outbox, first, {})
        assert [sender.step() for _ in range(3)] == [True, True, False]  # artifacts end a piece
    with closing(Outbox(path)) as outbox:
        sender = Sender(outbox, second, {})
        assert not sender.left
        assert sender.end()
    assert second.requests == 0 < first.requests
    assert differences(told, stored(outputs / "mlflow.db", "once")) == (0, 0)
    assert [*journal.journal_directory(outputs).iterdir()] == []


def test_one_process_sends_a_journal_at_a_time(outputs: Path) -> None:
    _, written = journaled(outputs)
    with closing(Outbox(written.path)) as outbox:
        with pytest.raises(BusyError, match="being sent by another process"):
            Outbox(written.path)
        assert not outbox.job_ended()
        assert not Sender(outbox, Store(default_uri(outputs), outputs), {}).end()
        assert written.path.exists()
        written.close()
        assert outbox.job_ended()
        outbox.delete()
    with pytest.raises(BusyError, match="is sent"):
        Outbox(written.path)
    assert [*written.path.parent.iterdir()] == []


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


def test_a_run_waits_for_the_one_above_it(outputs: Path) -> None:
    """The run of a sweep is in another journal; a job's run is not made without it, and not for ever withheld."""
    sweep, above = journaled(outputs)
    parent = sweep.start("sweep", tags={})
    job, below = journaled(outputs)
    run = job.start("job", parent=parent.local_id, tags={})
    run.tags({"romgrl.reused_from": f"teacher={parent.local_id} student=untracked"})
    run.finish()
    below.close()
    store = Store(default_uri(outputs), outputs)
    with closing(Outbox(below.path)) as outbox, pytest.raises(ParentError):
        Sender(outbox, store, {}).step()
    parent.finish()
    above.close()
    send_all(store, outputs)
    found = stored(outputs / "mlflow.db", "romgrl")
    ids = {name: run_id for name, _, run_id in found.runs}
    assert found.tags["job", "mlflow.parentRunId"] == ids["sweep"]
    assert found.tags["job", "romgrl.reused_from"] == f"teacher={ids['sweep']} student=untracked"
    orphan, left = journaled(outputs, "orphans")
    orphan.start("orphan", parent="local:gone", tags={}).finish()
    left.close()
    send_all(store, outputs)
    assert [name for name, _, _ in stored(outputs / "mlflow.db", "orphans").runs] == ["orphan"]


def resumed(outputs: Path, run_id: str, step: int) -> RecordedRun:
    """Go on in a run, and tell one number."""
    recorder, written = journaled(outputs)
    run = recorder.start("stage", tags={"stage": "stage"}, params={"a": 1}, run_id=run_id)
    run.metrics({"m": float(step)}, step)
    run.finish()
    written.close()
    return run


@pytest.mark.parametrize("local", [False, True])
def test_a_run_that_goes_on_stays_one_run(outputs: Path, local: bool) -> None:
    store = Store(default_uri(outputs), outputs)
    recorder, written = journaled(outputs)
    run = recorder.start("stage", tags={"stage": "stage"}, params={"a": 1})
    run.metrics({"m": 0.0}, 0)
    written.close()
    send_all(store, outputs)
    database = outputs / "mlflow.db"
    ((_, status, run_id),) = stored(database, "romgrl").runs
    assert status == "KILLED"
    resumed(outputs, run.local_id if local else run_id, 1)
    (path,) = journals(outputs)
    with closing(Outbox(path)) as outbox:
        entries, _ = outbox.read()
        sender = Sender(outbox, store, {})
        sender._send(entries[0])
        assert stored(database, "romgrl").runs == [("stage", "RUNNING", run_id)]
    late = {"do": "finish", "run": run.local_id.removeprefix("local:"), "at": entries[0]["at"] - 1, "status": "KILLED"}
    store.finish("romgrl", run_id, late)
    assert stored(database, "romgrl").runs == [("stage", "RUNNING", run_id)]
    send_all(store, outputs)
    found = stored(database, "romgrl")
    assert found.runs == [("stage", "FINISHED", run_id)]
    assert found.points == {("stage", "m", 0, 0.0): 1, ("stage", "m", 1, 1.0): 1}
    resumed(outputs, "0" * 32, 2)
    send_all(store, outputs)
    assert len(stored(database, "romgrl").runs) == 2


def test_what_the_store_refuses_does_not_hold_up_the_rest(outputs: Path) -> None:
    recorder, written = journaled(outputs)
    run = recorder.start("x", tags={}, params={"a": 1})
    recorder.start("again", tags={}, params={"a": 2}, run_id=run.local_id)
    run.artifacts(outputs / "not there")
    run.metrics({"m": 1.0}, 1)
    run.finish()
    written.close()
    store = Store(default_uri(outputs), outputs)
    with closing(Outbox(written.path)) as outbox:
        sender = Sender(outbox, store, {})
        while sender.step():
            pass
        assert sender.end()
    assert [line.partition(":")[0] for line in sender.refused] == ["start", "artifacts"]
    assert sender.refused[1] == f"artifacts: {outputs}/not there is gone"
    found = stored(outputs / "mlflow.db", "romgrl")
    assert (found.points, found.runs[0][1]) == ({("x", "m", 1, 1.0): 1}, "FINISHED")


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


def test_files_are_all_there(outputs: Path) -> None:
    tell(outputs, "files")
    send_all(Store(default_uri(outputs), outputs), outputs)
    copies = {path: path.read_bytes() for path in (outputs / "mlartifacts").rglob("*") if path.is_file()}
    assert sorted(copies.values()) == sorted(FILES.values())


def test_who_waits_for_a_journal_says_no_beat(tmp_path: Path) -> None:
    """So that a job does not wait at its end for a process that stands still with its journal in its hands."""
    link = SimpleNamespace(at_work=True)
    written = Journal(tmp_path, HEADER)
    other = Outbox(written.path)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(own_outbox, written.path, link)
        wait_until(lambda: not link.at_work)
        other.close()
        outbox = waiting.result()
    assert outbox is not None
    assert link.at_work
    outbox.close()
    written.close()


def test_runs_that_another_process_sent_are_named(outputs: Path) -> None:
    """Else their job would wait for the ids for ever: that process keeps them to itself."""
    recorder, written = journaled(outputs)
    run = recorder.start("teacher", tags={"stage": "teacher"})
    store = Store(default_uri(outputs), outputs)
    with closing(Outbox(written.path)) as outbox:
        other = Sender(outbox, store, {})
        while other.step():
            pass
        own = Sender(outbox, store, {})
        assert not own.step()
        own.name_sent()
    assert own.known == other.known
    assert list(own.known) == [run.local_id.removeprefix(LOCAL)]
