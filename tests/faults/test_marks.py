"""How far a store has a journal: it says so of one place, and a run keeps its state whatever is sent again."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from mlflow.exceptions import MlflowException

from romgrl.config.addresses import sqlite_address
from romgrl.tracking.journal import Outbox, journals
from romgrl.tracking.sending import syncing
from romgrl.tracking.sending.sender import Sender
from romgrl.tracking.sending.store import Store
from tests.faults.journals import journaled
from tests.faults.picky import Picky, refused
from tests.faults.runs import stored

AWAY = MlflowException("API request to http://x failed with exception connection refused")


def test_a_sync_to_another_place_that_breaks_off_takes_nothing_from_the_first(
    outputs: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(syncing, "PAUSE_SECONDS", 0.0)
    recorder, written = journaled(outputs)
    run = recorder.start("job", tags={"stage": "job"}, params={"a": 1})
    for step in range(2000):
        run.metrics({"m": float(step)}, step)
    run.finish()
    written.close()
    other, whole, calls = sqlite_address(outputs / "other.db"), Store.metrics, []

    def metrics(self: Store, run_id: str, entries: Any) -> None:
        if self.uri == other:
            calls.append(run_id)
            if len(calls) > 1:
                raise AWAY
        whole(self, run_id, entries)

    monkeypatch.setattr(Store, "metrics", metrics)
    for uri in (other, None):
        syncing.Sync(lambda *said: None, uri=uri, experiment=None, outputs=outputs).run()
    found = stored(outputs / "mlflow.db", "romgrl")
    assert (found.points.total(), found.params) == (2000, {("job", "a"): 1})
    assert journals(outputs) == []


def test_a_start_that_was_left_does_not_end_its_run_again(outputs: Path) -> None:
    recorder, written = journaled(outputs)
    recorder.start("job", tags={"stage": "job"}, params={"a": 1}).finish()
    written.close()
    errors = [refused("BAD_REQUEST"), AWAY]
    store = Picky(outputs, errors[0], lambda method, *_, params=None, **__: method == "log_batch" and bool(params))
    with closing(Outbox(written.path)) as outbox:
        while Sender(outbox, store, {}).step():
            pass
        store.error = AWAY
        sender = Sender(outbox, store, {})
        with pytest.raises(MlflowException):
            sender.end()
        store.refuses = lambda *_, **__: False
        assert sender.end()
    assert sender.statuses == dict.fromkeys(sender.starts, "FINISHED")
    assert [status for _, status, _ in stored(outputs / "mlflow.db", "romgrl").runs] == ["FINISHED"]
