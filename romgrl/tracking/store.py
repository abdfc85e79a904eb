"""Runs, parameters, metrics and artifacts in a store of MLflow; a request that is sent again changes nothing.

Metrics with the same key, step, time and value are one row of the store, parameters and tags are set to what they are,
files are overwritten with themselves, and a run is found again by the tag of its local id.
"""

from __future__ import annotations

import logging
import os
import re
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from json import JSONDecodeError
from pathlib import Path
from typing import Any, TypeVar

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "5")
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")  # what failed is sent again from the journal
os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")

import pandas as pd
from filelock import FileLock
from mlflow import MlflowClient
from mlflow.entities import Metric, Param, Run, RunTag, ViewType
from mlflow.exceptions import MlflowException
from sqlalchemy.exc import SQLAlchemyError

from romgrl.addresses import sqlite_path
from romgrl.journal import Entry
from romgrl.recorder import LOCAL
from romgrl.summary import LABELS

METRICS_PER_BATCH = 1000  # MLflow's own limits of one request
PARAMS_PER_BATCH = 100
PARAM_LENGTH = 6000
NAME_LENGTH = 250
TABLES = "tables"  # the folder of a run that has them
TABULATED = {f"{name}.csv" for name in ("mse", "distances", "gait", "robustness", "floquet", "jobs", "cells")}
STUDENT = "student"
NOT_IN_NAMES = re.compile(r"[^\w\-. :/]")
PARENT_TAG = "mlflow.parentRunId"
UID_TAG = "romgrl.uid"
RESUMED_TAG = "romgrl.resumed_at"
FAILURES = (MlflowException, SQLAlchemyError, sqlite3.Error, OSError, JSONDecodeError)  # of a store that is away
REFUSED = {"INVALID_PARAMETER_VALUE", "RESOURCE_DOES_NOT_EXIST"}  # whenever it is sent

T = TypeVar("T")


class RefusedError(Exception):
    """The store will never take a request."""


def chunks(items: Sequence[T], size: int) -> Iterator[Sequence[T]]:
    """Cut a sequence into pieces of at most `size`."""
    return (items[start : start + size] for start in range(0, len(items), size))


class Store:
    """One store. Raises FAILURES where it does not answer, RefusedError where it refuses."""

    def __init__(self, uri: str, outputs: Path, *, answered: Callable[[], None] = lambda: None) -> None:
        self.uri = uri
        self.on_disk = sqlite_path(uri) is not None
        self.asking = False
        self._outputs = outputs
        self._answered = answered
        self._client: MlflowClient | None = None
        self._experiments: dict[str, str] = {}

    def request(self, method: str, *arguments: Any, **named: Any) -> Any:
        """Call a method of the client and say that the store answered."""
        self.asking = True
        try:
            if self._client is None:
                self._client = open_client(self.uri, self._outputs)
            answer = getattr(self._client, method)(*arguments, **named)
        except MlflowException as error:
            if error.error_code in REFUSED:
                self._answered()
                raise RefusedError(first_line(error)) from error
            raise
        finally:
            self.asking = False
        self._answered()
        return answer

    def experiment_id(self, name: str) -> str:
        """Find or make an experiment."""
        if name not in self._experiments:
            known = self.request("get_experiment_by_name", name) or self.make_experiment(name)
            self._experiments[name] = whole(known.experiment_id)
        return self._experiments[name]

    def make_experiment(self, name: str) -> Any:
        """Make an experiment, or find the one that another process has just made."""
        try:
            location = (self._outputs.resolve() / "mlartifacts").as_uri() if self.on_disk else None
            self.request("create_experiment", name, artifact_location=location)
        except MlflowException as error:
            if error.error_code != "RESOURCE_ALREADY_EXISTS":
                raise
        return self.request("get_experiment_by_name", name)

    def find(self, experiment: str, uid: str) -> list[Run]:
        """The runs with a local id, the one that has most first. There is one, unless an answer was lost."""
        text = f"tags.`{UID_TAG}` = '{uid}'"
        found = self.request("search_runs", [self.experiment_id(experiment)], text, run_view_type=ViewType.ALL)
        return sorted(found, key=lambda run: (-len(run.data.params) - len(run.data.metrics), run.info.run_id))

    def find_or_start(self, experiment: str, entry: Entry, parent: str | None) -> str:
        """MLflow's id of the run that a request started: it is there already, goes on, or is made."""
        found = self.find(experiment, entry["run"])
        if not found and entry["run_id"] and not entry["run_id"].startswith(LOCAL):
            found = self.existing(entry["run_id"])
        if found:
            return whole(found[0].info.run_id)
        tags = {**entry["tags"], UID_TAG: entry["run"], **({PARENT_TAG: parent} if parent else {})}
        run = self.request("create_run", self.experiment_id(experiment), entry["at"], tags, entry["name"])
        return whole(run.info.run_id)

    def existing(self, run_id: str) -> list[Run]:
        """The run with an id of MLflow's, if there is one."""
        try:
            return [self.request("get_run", run_id)]
        except RefusedError:
            return []

    def describe(self, run_id: str, entry: Entry) -> None:
        """Log tags and parameters of the request that starts a run; one that goes on is running again."""
        if entry["run_id"]:
            run = self.request("get_run", run_id)
            self.tags(run_id, entry["tags"])
            if max(run.info.end_time or 0, int(run.data.tags.get(RESUMED_TAG, 0))) < entry["at"]:
                self.request("update_run", run_id, status="RUNNING")
                self.tags(run_id, {RESUMED_TAG: str(entry["at"])})
        params = [Param(name, str(value)[:PARAM_LENGTH]) for name, value in entry["params"].items()]
        for batch in chunks(params, PARAMS_PER_BATCH):
            self.request("log_batch", run_id, params=batch)

    def tags(self, run_id: str, tags: Mapping[str, str]) -> None:
        """Set tags."""
        self.request("log_batch", run_id, tags=[RunTag(name, str(value)) for name, value in tags.items()])

    def metrics(self, run_id: str, entries: Sequence[Entry]) -> None:
        """Log the numbers of requests."""
        points = [
            Metric(NOT_IN_NAMES.sub("_", name)[:NAME_LENGTH], value, entry["at"], entry["step"])
            for entry in entries
            for name, value in entry["values"].items()
        ]
        for batch in chunks(points, METRICS_PER_BATCH):
            self.request("log_batch", run_id, metrics=batch)

    def artifacts(self, run_id: str, directory: Path) -> None:
        """Copy every file of a directory to the run, one after the other: each is an answer."""
        if not directory.is_dir():
            raise RefusedError(f"{directory} is gone")
        for file in sorted(path for path in directory.rglob("*") if path.is_file()):
            folder = file.parent.relative_to(directory)
            self.request("log_artifact", run_id, str(file), None if folder == Path() else folder.as_posix())
            if file.name in TABULATED and folder == Path():
                self.table(run_id, file)

    def watch_machine(self, run_id: str) -> None:
        """Record the load of this machine, in a thread that ends once the run has or the store is away."""
        from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

        SystemMetricsMonitor(run_id, tracking_uri=self.uri).start()

    def table(self, run_id: str, file: Path) -> None:
        """Log a CSV file as a table of the UI, too; one that is there already stays, as MLflow would add to it."""
        name = f"{TABLES}/{file.stem}.json"
        if any(known.path == name for known in self.request("list_artifacts", run_id, TABLES)):
            return
        try:
            rows = pd.read_csv(file)
        except ValueError as error:
            raise RefusedError(f"{file}: {first_line(error)}") from error
        self.request("log_table", run_id, readable(rows, LABELS.get(file.name, ())), name)

    def finish(self, experiment: str, run_id: str, entry: Entry) -> None:
        """Close a run, unless it went on after this request; runs that a lost answer made are deleted."""
        for double in self.find(experiment, entry["run"]):
            empty = not double.data.metrics and not double.data.params
            if empty and double.info.run_id != run_id and double.info.lifecycle_stage == "active":
                self.request("delete_run", double.info.run_id)
        run = self.request("get_run", run_id)
        if int(run.data.tags.get(RESUMED_TAG, 0)) <= entry["at"]:
            self.request("set_terminated", run_id, entry["status"], entry["at"])

    def close(self) -> None:
        """Bring all that is stored into the database file itself: empty the write-ahead log of SQLite."""
        if self._client is not None and (database := sqlite_path(self.uri)) is not None:
            with closing(sqlite3.connect(database)) as store:
                store.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def readable(rows: pd.DataFrame, labels: Sequence[str]) -> pd.DataFrame:
    """A table as MLflow's comparison of tables shows it best: what names a row in one column, the student next to it.

    The UI groups by the first column and compares the second one; it shows ten digits of a number, so four are left.
    """
    names = [name for name in labels if name in rows]
    rows = rows.map(lambda cell: float(f"{cell:.4g}") if isinstance(cell, float) else cell)
    if len(names) > 1:
        rows.insert(0, ", ".join(names), rows[names].astype(str).agg(", ".join, axis=1))
        rows = rows.drop(columns=names)
    if len(names) > 0 and STUDENT in rows:
        rows.insert(1, STUDENT, rows.pop(STUDENT))
    return rows


def open_client(uri: str, outputs: Path) -> MlflowClient:
    """Connect. One process at a time migrates a fresh SQLite store and sets WAL."""
    for name in ("mlflow", "alembic"):  # migrations are no news
        logging.getLogger(name).setLevel(logging.WARNING)
    database = sqlite_path(uri)
    if database is None:
        return MlflowClient(tracking_uri=uri)
    outputs.mkdir(parents=True, exist_ok=True)
    with FileLock(outputs / ".mlflow.lock"):
        with closing(sqlite3.connect(database)) as store:
            store.execute("PRAGMA journal_mode=WAL")
        client = MlflowClient(tracking_uri=uri)
        client.get_experiment_by_name("Default")
        return client


def whole(identifier: str) -> str:
    """An id from an answer. One that broke off after its first line reads as if it were empty."""
    if not identifier:
        raise OSError("the answer broke off")
    return identifier


def first_line(error: BaseException) -> str:
    """What went wrong, on one line."""
    return (str(error).splitlines() or [type(error).__name__])[0]
