"""Runs, parameters, metrics and artifacts in MLflow; the only module that imports it.

Tracking never costs a training: every failure is told once, the numbers stay in curve.csv, and the stage goes on.
"""

from __future__ import annotations

import logging
import os
import queue
import re
import shlex
import shutil
import sqlite3
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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

FLUSH_SECONDS = 2.0
CLOSE_SECONDS = 20.0
METRICS_PER_BATCH = 1000  # MLflow's own limits of one request
PARAMS_PER_BATCH = 100
PARAM_LENGTH = 6000
NOT_IN_NAMES = re.compile(r"[^\w\-. :/]")
PARENT_TAG = "mlflow.parentRunId"
FAILURES = (MlflowException, SQLAlchemyError, sqlite3.Error, OSError)

T = TypeVar("T")


def default_uri(outputs: Path) -> str:
    """The SQLite store of an output directory."""
    return f"sqlite:///{outputs.resolve() / 'mlflow.db'}"


def ui_command(uri: str) -> str:
    """The command that shows the runs of a store on this machine; the server listens on loopback only."""
    if uri.startswith("http"):
        return f"open {uri}"
    beside_python = Path(sys.executable).with_name("mlflow")
    program = "mlflow" if shutil.which("mlflow") or not beside_python.exists() else shlex.quote(str(beside_python))
    return f"{program} ui --backend-store-uri {shlex.quote(uri)}"


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


class Tracker:
    """Makes runs in one store; without a client (tracking disabled or out of reach) all of them do nothing."""

    def __init__(self, *, uri: str | None, experiment: str, outputs: Path, enabled: bool = True) -> None:
        self.uri = uri or default_uri(outputs)
        self._warned = False
        self.client: MlflowClient | None = None
        self.experiment_id = ""
        opened = self.attempt(lambda: open_client(self.uri, outputs, experiment)) if enabled else None
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
        self, name: str, *, parent: str | None = None, tags: Mapping[str, str], params: Mapping[str, Any] | None = None
    ) -> TrackedRun:
        """Start a run with its tags and flattened parameters."""
        client = self.client
        if client is None:
            return TrackedRun(self, None)
        all_tags = {**tags, **({PARENT_TAG: parent} if parent else {})}
        run = self.attempt(lambda: client.create_run(self.experiment_id, tags=all_tags, run_name=name))
        tracked = TrackedRun(self, run.info.run_id if run else None)
        tracked.params(params or {})
        return tracked


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

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Queue numbers at a step; returns at once."""
        now = int(time.time() * 1000)
        if self.run_id is not None:
            for name, value in values.items():
                self._queue.put(Metric(NOT_IN_NAMES.sub("_", name), value, now, step))

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
