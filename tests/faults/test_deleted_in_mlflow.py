"""What somebody deleted in MLflow: one line says so, with the way back, and nothing else waits for it."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

from romgrl.tracking.journal import Outbox, journals
from romgrl.tracking.recorder import default_uri
from romgrl.tracking.sending.failures import ExperimentError
from romgrl.tracking.sending.sender import Sender
from romgrl.tracking.sending.store import Store
from tests.faults.journals import journaled, tell
from tests.faults.picky import beside, send, synced
from tests.faults.runs import differences, stored


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("romgrl.tracking.sending.syncing.PAUSE_SECONDS", 0.0)


def test_a_deleted_experiment_is_named_with_the_way_back(outputs: Path) -> None:
    store = Store(default_uri(outputs), outputs)
    number = store.experiment_id("romgrl")
    store.request("delete_experiment", number)
    told, other = tell(outputs, "romgrl"), tell(outputs, "another")
    with pytest.raises(ExperimentError, match="the experiment romgrl was deleted"):
        send(Store(default_uri(outputs), outputs), outputs)
    said = synced(outputs)
    ((_, text),) = [line for line in said if line[0] == "failure"]
    assert f"mlflow experiments restore --experiment-id {number}" in text
    assert "tracking.experiment=" in text
    assert differences(other, stored(outputs / "mlflow.db", "another")) == (0, 0)
    store.request("restore_experiment", number)
    synced(outputs)
    assert differences(told, stored(outputs / "mlflow.db", "romgrl")) == (0, 0)
    assert journals(outputs) == []


def test_an_experiment_that_is_deleted_under_a_job(outputs: Path) -> None:
    store = Store(default_uri(outputs), outputs)
    number = store.experiment_id("romgrl")
    Store(default_uri(outputs), outputs).request("delete_experiment", number)
    tell(outputs, "romgrl")
    with pytest.raises(ExperimentError, match="was deleted"):
        send(store, outputs)
    assert {kind for kind, _ in synced(outputs, experiment="new")} == {"text"}
    assert len(stored(outputs / "mlflow.db", "new").runs) == 2


@pytest.mark.parametrize("local", [False, True])
def test_a_run_that_was_deleted_goes_on_in_a_new_one(outputs: Path, local: bool) -> None:
    lines: list[str] = []
    store = Store(default_uri(outputs), outputs, tell=lambda topic, text: lines.append(text))
    recorder, written = journaled(outputs)
    run = recorder.start("stage", tags={"stage": "stage"}, params={"a": 1})
    run.metrics({"m": 0.0}, 0)
    written.close()
    send(store, outputs)
    ((_, _, run_id),) = stored(outputs / "mlflow.db", "romgrl").runs
    store.request("delete_run", run_id)
    for step in (1, 2):  # the second time it goes on in the new one
        recorder, written = journaled(outputs)
        again = recorder.start(
            "stage", tags={"stage": "stage"}, params={"a": 1}, run_id=run.local_id if local else run_id
        )
        again.metrics({"m": float(step)}, step)
        again.finish()
        written.close()
        send(store, outputs)
        if not local:
            run_id = stored(outputs / "mlflow.db", "romgrl").runs[0][2]
    found = stored(outputs / "mlflow.db", "romgrl")
    assert [(name, status) for name, status, _ in found.runs] == [("stage", "FINISHED")]
    assert found.points == {("stage", "m", 1, 1.0): 1, ("stage", "m", 2, 2.0): 1}
    assert found.params == {("stage", "a"): 1}
    assert (len(lines), "was deleted: stage is in a new one" in lines[0]) == (1, True)


def test_a_run_that_is_deleted_under_its_training_is_told(outputs: Path) -> None:
    lines: dict[str, str] = {}
    store = Store(default_uri(outputs), outputs, tell=lambda topic, text: lines.setdefault(topic, text))
    recorder, written = journaled(outputs)
    run = recorder.start("stage", tags={}, params={"a": 1})
    with closing(Outbox(written.path)) as outbox:
        sender = Sender(outbox, store, {})
        sender.step()
        store.request("delete_run", sender.known[run.local_id.removeprefix("local:")])
        for step in range(5):
            run.metrics({"m": float(step)}, step)
        recorder.start("other", tags={}).finish()
        run.finish()
        written.close()
        while sender.step():
            pass
        assert sender.end()
    assert lines["deleted"].startswith("the run of stage was deleted in MLflow, which takes no more of it; kept in ")
    assert [name for name, *_ in stored(outputs / "mlflow.db", "romgrl").runs] == ["other"]
    assert len(beside(outputs, "refused")[0].read_text(encoding="utf-8").splitlines()) == 5 + 1
    assert journals(outputs) == []
