"""A store that answers, but does not take everything: files that have no place, requests that are refused, and what
somebody deleted. Nothing else waits for it, one line says what it is, and it arrives once the store is mended."""

from __future__ import annotations

import errno
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import requests
from mlflow.exceptions import MlflowException, RestException

from romgrl.tracking.journal import Outbox, journal_directory, journals
from romgrl.tracking.recorder import Recorder, default_uri
from romgrl.tracking.sending.failures import explained
from romgrl.tracking.sending.fetching import find_run
from romgrl.tracking.sending.files import FILES_TAG
from romgrl.tracking.sending.sender import Sender
from romgrl.tracking.sending.store import Store
from tests.faults.journals import journaled, tell
from tests.faults.picky import Picky, beside, refused, send, synced
from tests.faults.runs import FILES, differences, stored
from tests.helpers.jobs import Command

Fault = Callable[[], Exception]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("romgrl.tracking.sending.syncing.PAUSE_SECONDS", 0.0)


def http(status: int) -> requests.HTTPError:
    response = requests.Response()
    response.status_code = status
    return requests.HTTPError(f"{status} from a proxy", response=response)


NO_PLACE = {
    "permission": (PermissionError(errno.EACCES, "Permission denied"), "Permission denied"),
    "no boto3": (ModuleNotFoundError("No module named 'boto3'"), "a library is missing here (No module named 'boto3')"),
    "no credentials": (RuntimeError("Unable to locate credentials"), "Unable to locate credentials"),
    "too large": (http(413), "the answer is 413 (too large for a proxy before it)"),
    "forbidden": (http(403), "the answer is 403"),
    "broken proxy": (http(500), "the answer is 500"),
    "cut": (requests.ConnectionError("connection reset"), "connection reset"),
}


@pytest.mark.parametrize("name", NO_PLACE)
def test_files_that_have_no_place_hold_nothing_back(outputs: Path, name: str) -> None:
    error, why = NO_PLACE[name]
    told = tell(outputs, "romgrl")
    store = Picky(outputs, error, lambda method, *_, **__: method == "log_artifact")
    assert send(store, outputs) == []
    found = stored(outputs / "mlflow.db", "romgrl")
    assert differences(told, found) == (0, 0)
    assert found.tags["stage", FILES_TAG].startswith(f"{told.directory} on ")
    assert len(set(store.told)) == 1
    assert why in store.told[0]
    assert len(beside(outputs, "left")) == 1
    _, text = next(line for line in synced_with(outputs, error) if line[0] == "failure")
    assert why in text
    assert [kind for kind, _ in synced(outputs)] == ["text"]
    found = stored(outputs / "mlflow.db", "romgrl")
    assert ("stage", FILES_TAG) not in found.tags
    files = {path.read_bytes() for path in (outputs / "mlartifacts").rglob("*") if path.is_file()}
    assert files == set(FILES.values())
    assert [*journal_directory(outputs).iterdir()] == []


def synced_with(outputs: Path, error: Exception) -> list[tuple[str, str]]:
    """What a sync says to a store that still takes no file."""
    with pytest.MonkeyPatch.context() as patch:
        whole = Store.request

        def request(self: Store, method: str, *arguments: Any, **named: Any) -> Any:
            if method == "log_artifact":
                raise error
            return whole(self, method, *arguments, **named)

        patch.setattr(Store, "request", request)
        return synced(outputs)


def test_an_experiment_whose_files_go_to_a_place_that_is_not_here(outputs: Path) -> None:
    """As on a server without --serve-artifacts; another experiment gets the whole journal."""
    store = Store(default_uri(outputs), outputs, tell=lambda topic, text: told_lines.append(text))
    told_lines: list[str] = []
    store.request("create_experiment", "nowhere", artifact_location="file:///proc/romgrl")
    told = tell(outputs, "nowhere")
    store.uri = "http://server"  # for its words only
    send(store, outputs)
    assert differences(told, stored(outputs / "mlflow.db", "nowhere")) == (0, 0)
    (line,) = set(told_lines)
    assert "they would go to file:///proc/romgrl/" in line
    assert "the server needs --serve-artifacts" in line
    assert find_run(store, "nowhere", "stage", "key") is None
    assert {kind for kind, _ in synced(outputs, experiment="elsewhere")} == {"text"}
    assert differences(told, stored(outputs / "mlflow.db", "elsewhere")) == (0, 0)
    assert len([path for path in (outputs / "mlartifacts").rglob("*") if path.is_file()]) == len(FILES)
    assert journals(outputs) == []


def test_a_run_without_its_files_is_not_offered(outputs: Path) -> None:
    store = Store(default_uri(outputs), outputs)
    experiment = store.experiment_id("romgrl")
    ids = []
    for tags in ({}, {FILES_TAG: "/here"}, {}):
        run = store.request("create_run", experiment, tags={"stage": "teacher", "key": "1", **tags})
        store.request("set_terminated", run.info.run_id)
        ids.append(run.info.run_id)
    store.request("delete_run", ids[2])
    assert find_run(store, "romgrl", "teacher", "1") == ids[0]


def of_metrics(method: str, *_: Any, metrics: list[Any] | None = None, **__: Any) -> bool:
    return method == "log_batch" and any(metric.key == "return" and metric.step == 2 for metric in metrics or ())


@pytest.mark.parametrize("code", ["BAD_REQUEST", "INTERNAL_ERROR"])
def test_one_number_that_is_refused_takes_no_other_with_it(outputs: Path, code: str) -> None:
    told = tell(outputs, "romgrl")
    store = Picky(outputs, refused(code), of_metrics)
    send(store, outputs)
    found = stored(outputs / "mlflow.db", "romgrl")
    assert found.points.total() == len(told.points) - 3  # the three numbers of one call
    assert {status for _, status, _ in found.runs} == {"FINISHED"}
    assert "MLflow does not take metrics of stage" in store.told[0]
    assert str(beside(outputs, "left")[0]) in store.told[0]
    assert synced(outputs)[-1][0] == "text"
    assert differences(told, stored(outputs / "mlflow.db", "romgrl")) == (0, 0)
    assert journals(outputs) == []


def test_what_is_refused_whenever_it_is_sent_is_kept_and_told(outputs: Path) -> None:
    tell(outputs, "romgrl")
    store = Picky(outputs, refused("BAD_REQUEST"), lambda *_, **__: False)
    whole = store.describe

    def describe(run_id: str, entry: Any) -> None:
        whole(run_id, entry)
        store.request("log_param", run_id, "seed", "another")

    store.describe = describe
    assert len(send(store, outputs)) == 2
    assert journals(outputs) == []
    assert len(beside(outputs, "refused")[0].read_text(encoding="utf-8").splitlines()) == 2
    assert "MLflow refuses start of job (" in store.told[0]


def test_a_run_that_cannot_be_made_holds_up_no_other(outputs: Path) -> None:
    told = tell(outputs, "romgrl")
    store = Picky(outputs, refused("BAD_REQUEST"), lambda method, *arguments, **_: arguments[3:] == ("job",))
    send(store, outputs)
    assert [name for name, *_ in stored(outputs / "mlflow.db", "romgrl").runs] == ["stage"]
    synced(outputs)
    found = stored(outputs / "mlflow.db", "romgrl")
    assert [(name, status) for name, status, _ in found.runs] == [("job", "FINISHED"), ("stage", "FINISHED")]
    assert found.points.total() == len(told.points)
    assert journals(outputs) == []


@pytest.mark.parametrize(
    "error",
    [
        RestException({"error_code": "PERMISSION_DENIED", "message": "no"}),
        RestException({"error_code": "TEMPORARILY_UNAVAILABLE", "message": "locked"}),
        MlflowException("API request to http://x failed with exception too many 503 error responses"),
        MlflowException("API request to http://x failed with exception connection refused"),
    ],
)
def test_a_store_that_may_come_back_is_waited_for(outputs: Path, error: Exception) -> None:
    told = tell(outputs, "romgrl")
    for _ in range(3):
        with pytest.raises(MlflowException):
            send(Picky(outputs, error, of_metrics), outputs)
        assert beside(outputs, "left") == []
    send(Store(default_uri(outputs), outputs), outputs)
    assert differences(told, stored(outputs / "mlflow.db", "romgrl")) == (0, 0)


def test_names_and_values_are_as_short_as_every_store_takes_them(outputs: Path) -> None:
    store = Store(default_uri(outputs), outputs)
    recorder, written = journaled(outputs, "e" * 600)
    run = recorder.start("sweep " + "n" * 600, tags={"t" * 300: "v" * 9000}, params={"p" * 300: "w" * 9000})
    run.metrics({"m" * 300: 1.0}, 1)
    run.describe("d" * 9000)
    run.finish()
    written.close()
    send(store, outputs)
    (found,) = store.request("search_runs", [store.experiment_id("e" * 600)])
    assert (len(found.info.run_name), found.info.run_name[-4:]) == (250, "n...")
    assert found.data.params == {"p" * 247 + "...": "w" * 5997 + "..."}
    assert list(found.data.metrics) == ["m" * 247 + "..."]
    assert found.data.tags["t" * 247 + "..."] == "v" * 7997 + "..."
    assert max(len(value) for value in found.data.tags.values()) == 8000
    assert len(store.request("get_experiment", found.info.experiment_id).name) == 250


WORDS = {
    "host": (
        "API request to endpoint /x failed with error code 403 != 200. Response body: 'Invalid Host header - possible'",
        "it refuses the name box:5000: start it with --allowed-hosts box:5000, and its other names",
    ),
    "html": (
        "API request to endpoint was successful but the response body was not in a valid JSON format",
        "what answers there is no MLflow server",
    ),
    "older": (
        "Detected out-of-date database schema (found version 0584bdc529eb, but expected dc11669786a5). Take a backup",
        "those of an older MLflow: cp '/a b.db' '/a b.db.backup' && mlflow db upgrade 'sqlite:////a b.db'",
    ),
    "newer": (
        "Detected out-of-date database schema (found version ffffffffffff, but expected dc11669786a5). Take a backup",
        "those of a newer MLflow than the ",
    ),
    "certificate": ("API request to x failed with exception SSLError [SSL: CERTIFICATE_VERIFY_FAILED]", "not trusted"),
}


@pytest.mark.parametrize("name", WORDS)
def test_the_line_names_the_remedy(name: str) -> None:
    text, wanted = WORDS[name]
    uri = "sqlite:////a b.db" if name in ("older", "newer") else "http://ann:secret@box:5000"
    line = explained(MlflowException(text), uri)
    assert wanted in line
    assert "secret" not in line


def test_a_server_that_wants_a_user() -> None:
    error = RestException({"error_code": "UNAUTHENTICATED", "message": "You are not authenticated"})
    assert "MLFLOW_TRACKING_USERNAME" in explained(error, "http://box:5000")


def test_a_job_does_not_wait_for_the_id_of_a_run_that_is_never_made(outputs: Path) -> None:
    told = tell(outputs, "romgrl")
    store = Picky(outputs, http(413), lambda method, *_, **__: method == "create_run")
    with closing(Outbox(journals(outputs)[0])) as outbox:
        sender = Sender(outbox, store, {})
        while sender.step():
            pass
        assert sender.unmade == set(sender.starts)
    assert told.directory.is_dir()


def test_a_job_does_not_wait_for_ever_for_a_process_that_is_at_work(
    outputs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("romgrl.tracking.process.LONGEST_SECONDS", 0.5)
    recorder = Recorder(default_uri(outputs), "romgrl", outputs)
    assert recorder.process is not None
    assert not recorder.process.wait(lambda: False)
    assert recorder.process.reason is not None
    assert "without an answer" in recorder.process.reason
    recorder.close()


def test_a_store_that_makes_no_run_ends_no_job(command: Command) -> None:
    """A store without workspaces, which the environment asks for, answers and refuses every run."""
    ended = command("stage=teacher", MLFLOW_ENABLE_WORKSPACES="true")
    assert ended.returncode == 0
    assert "mlflow run: local:" in ended.stdout
