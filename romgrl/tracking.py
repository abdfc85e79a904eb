"""Runs, parameters, metrics and artifacts in MLflow; the only module that imports it.

Tracking never costs a training: every failure is told once, the numbers stay in curve.csv, and the stage goes on. The
pipeline runs this module as a process of its own and talks to it through romgrl.recorder.
"""

from __future__ import annotations

import logging
import os
import queue
import re
import signal
import sqlite3
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "5")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")

from filelock import FileLock
from mlflow import MlflowClient
from mlflow.entities import Metric, Param, RunTag
from mlflow.exceptions import MlflowException
from rich.console import Console
from sqlalchemy.exc import SQLAlchemyError

from romgrl.recorder import ANSWERED, now

FLUSH_SECONDS = 2.0
CLOSE_SECONDS = 20.0
METRICS_PER_BATCH = 1000  # MLflow's own limits of one request
PARAMS_PER_BATCH = 100
PARAM_LENGTH = 6000
NOT_IN_NAMES = re.compile(r"[^\w\-. :/]")
PARENT_TAG = "mlflow.parentRunId"
FAILURES = (MlflowException, SQLAlchemyError, sqlite3.Error, OSError)

T = TypeVar("T")


def flatten(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested mappings to dotted names."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= flatten(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {prefix + name: value}
    return flat


def chunks(items: Sequence[T], size: int) -> Iterator[Sequence[T]]:
    """Cut a sequence into pieces of at most `size`."""
    return (items[start : start + size] for start in range(0, len(items), size))


def open_client(uri: str, outputs: Path, experiment: str) -> tuple[MlflowClient, str]:
    """Connect and find or make the experiment. One process at a time migrates a fresh SQLite store and sets WAL."""
    outputs.mkdir(parents=True, exist_ok=True)
    with FileLock(outputs / ".mlflow.lock"):
        for name in ("mlflow", "alembic"):  # migrations are no news
            logging.getLogger(name).setLevel(logging.WARNING)
        client = MlflowClient(tracking_uri=uri)
        location = None
        if uri.startswith("sqlite:"):
            with sqlite3.connect(uri.removeprefix("sqlite:///")) as store:
                store.execute("PRAGMA journal_mode=WAL")
            store.close()
            location = (outputs.resolve() / "mlartifacts").as_uri()
        known = client.get_experiment_by_name(experiment)
        return client, known.experiment_id if known else client.create_experiment(
            experiment, artifact_location=location
        )


def checkpoint(uri: str) -> None:
    """Empty the write-ahead log of a SQLite store."""
    with closing(sqlite3.connect(uri.removeprefix("sqlite:///"))) as store:
        store.execute("PRAGMA wal_checkpoint(TRUNCATE)")


class Tracker:
    """Makes runs in one store; without a client (out of reach) all of them do nothing."""

    def __init__(self, *, uri: str, experiment: str, outputs: Path) -> None:
        self.uri = uri
        self._warned = False
        self.client: MlflowClient | None = None
        self.experiment_id = ""
        opened = self.attempt(lambda: open_client(uri, outputs, experiment))
        if opened:
            self.client, self.experiment_id = opened

    def attempt(self, action: Callable[[], T]) -> T | None:
        """Run one request; the first failure is told, the rest are silent. Returns None where it failed."""
        try:
            return action()
        except FAILURES as error:
            if not self._warned:
                self._warned = True
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                Console(stderr=True).print(
                    f"warning: MLflow at {self.uri} failed ({reason}); going on without", soft_wrap=True
                )
            return None

    def start(
        self,
        name: str,
        *,
        parent: str | None = None,
        tags: Mapping[str, str],
        params: Mapping[str, Any] | None = None,
        at: int | None = None,
    ) -> TrackedRun:
        """Start a run with its tags and flattened parameters, `at` milliseconds since 1970 (None: now)."""
        client = self.client
        if client is None:
            return TrackedRun(self, None)
        all_tags = {**tags, **({PARENT_TAG: parent} if parent else {})}
        run = self.attempt(lambda: client.create_run(self.experiment_id, at or now(), all_tags, name))
        tracked = TrackedRun(self, run.info.run_id if run else None)
        tracked.params(params or {})
        return tracked

    def close(self) -> None:
        """Bring all that is stored into the database file itself."""
        if self.client is not None and self.uri.startswith("sqlite:"):
            self.attempt(lambda: checkpoint(self.uri))


class TrackedRun:
    """One run. `metrics` only fills a queue; a thread sends it in batches, so that training never waits."""

    def __init__(self, tracker: Tracker, run_id: str | None) -> None:
        self.run_id = run_id
        self._tracker = tracker
        self._queue: queue.SimpleQueue[Metric] = queue.SimpleQueue()
        self._pending: list[Metric] = []
        self._closing = threading.Event()
        self._sender = threading.Thread(target=self._send_until_closed, name="mlflow", daemon=True)
        if run_id is not None:
            self._sender.start()

    def _call(self, method: str, *arguments: Any, **named: Any) -> bool:
        client, run_id = self._tracker.client, self.run_id
        if client is None or run_id is None:
            return False
        return self._tracker.attempt(lambda: (getattr(client, method)(run_id, *arguments, **named), True)) is not None

    def params(self, params: Mapping[str, Any]) -> None:
        """Log parameters, nested ones under dotted names."""
        entries = [Param(name, str(value)[:PARAM_LENGTH]) for name, value in flatten(params).items()]
        for batch in chunks(entries, PARAMS_PER_BATCH):
            self._call("log_batch", params=batch)

    def tags(self, tags: Mapping[str, str]) -> None:
        """Set tags."""
        self._call("log_batch", tags=[RunTag(name, value) for name, value in tags.items()])

    def metrics(self, values: Mapping[str, float], step: int, at: int | None = None) -> None:
        """Queue numbers at a step, taken `at` milliseconds since 1970 (None: now); returns at once."""
        if self.run_id is not None:
            for name, value in values.items():
                self._queue.put(Metric(NOT_IN_NAMES.sub("_", name), value, at or now(), step))

    def artifacts(self, directory: Path) -> None:
        """Copy every file of a directory to the run."""
        self._call("log_artifacts", str(directory))

    def finish(self, status: str = "FINISHED") -> None:
        """Send what is queued and close the run: FINISHED, FAILED or KILLED."""
        if self.run_id is not None and not self._closing.is_set():
            self._closing.set()
            self._sender.join(CLOSE_SECONDS)
            self._call("set_terminated", status)

    def _send_until_closed(self) -> None:
        while not self._closing.wait(FLUSH_SECONDS):
            self._send()
        self._send()

    def _send(self) -> None:
        """Send all queued metrics; what fails stays first in line for the next time."""
        while not self._queue.empty():
            self._pending.append(self._queue.get())
        while self._pending and self._call("log_batch", metrics=self._pending[:METRICS_PER_BATCH]):
            del self._pending[:METRICS_PER_BATCH]


def serve(connection: Connection) -> None:
    """Do what a Recorder sends, in its order, until it closes the pipe; then the runs that it left open are killed."""
    tracker = Tracker(**connection.recv())
    runs: dict[int, TrackedRun] = {}
    with suppress(EOFError, OSError):
        while True:
            number, run, method, arguments, named = connection.recv()
            if method == "start":
                parent = named.pop("parent")
                parent = runs[parent].run_id if isinstance(parent, int) else parent
                runs[number] = tracker.start(*arguments, parent=parent, **named)
            else:
                getattr(runs[run], method)(*arguments, **named)
            if method in ANSWERED:
                connection.send((number, runs[number].run_id if method == "start" else None))
    for left in runs.values():
        left.finish("KILLED")
    tracker.close()


def main() -> None:
    """Serve the pipe whose file descriptor is the only argument; signals are the pipeline's to answer."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    serve(Connection(int(sys.argv[1])))
    os._exit(0)  # all is stored; taking MLflow apart would be half a second for nothing


if __name__ == "__main__":
    main()
