"""The journal of what MLflow is told: every request of a sender fails in turn, lines tear, disks are full."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from romgrl.tracking import journal
from romgrl.tracking.journal import BusyError, Journal, Outbox, journals
from romgrl.tracking.recorder import LOCAL, RecordedRun, default_uri
from romgrl.tracking.sending.__main__ import own_outbox
from romgrl.tracking.sending.sender import ParentError, Sender
from romgrl.tracking.sending.store import Store
from tests.faults.journals import journaled, tell
from tests.faults.runs import FILES, differences, stored
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


def send_all(store: Store, outputs: Path) -> None:
    """Send every journal to its end, as one process would."""
    for path in journals(outputs):
        with closing(Outbox(path)) as outbox:
            sender = Sender(outbox, store, {})
            while sender.step():
                pass
            sender.end()


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
