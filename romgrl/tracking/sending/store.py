"""Runs, parameters, metrics and artifacts in a store of MLflow; a request that is sent again changes nothing.

Metrics with the same key, step, time and value are one row of the store, parameters and tags are set to what they are,
files are overwritten with themselves, and a run is found again by the tag of its local id.
"""

from __future__ import annotations

import logging
import shlex
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, TypeVar

from filelock import FileLock
from mlflow import MlflowClient
from mlflow.entities import Metric, Param, Run, RunTag, ViewType
from mlflow.exceptions import MlflowException

from romgrl.artifacts import lock_mode
from romgrl.config.addresses import sqlite_path, with_driver
from romgrl.tracking.journal import Entry, redacted
from romgrl.tracking.recorder import LOCAL
from romgrl.tracking.sending.failures import DELETED, FAILURES, REFUSED, ExperimentError, RefusedError, first_line
from romgrl.tracking.sending.files import send_files
from romgrl.tracking.sending.fitting import (
    ENTITIES_PER_BATCH,
    METRICS_PER_BATCH,
    PARAM_LENGTH,
    TAG_LENGTH,
    key_of,
    shortened,
)

PARENT_TAG = "mlflow.parentRunId"
UID_TAG = "romgrl.uid"
RESUMED_TAG = "romgrl.resumed_at"
STORE_LOCK_SECONDS = 60.0  # that another process may take to make the tables of a fresh store
ACTIVE = "active"

T = TypeVar("T")


def chunks(items: Sequence[T], size: int) -> Iterator[Sequence[T]]:
    """Cut a sequence into pieces of at most `size`."""
    return (items[start : start + size] for start in range(0, len(items), size))


class Store:
    """One store. Raises FAILURES where it does not answer, RefusedError where it refuses."""

    def __init__(
        self,
        uri: str,
        outputs: Path,
        *,
        answered: Callable[[], None] = lambda: None,
        tell: Callable[[str, str], None] = lambda topic, text: None,
    ) -> None:
        self.uri = uri
        self.tell = tell  # something that the store answered, by its topic
        self.on_disk = sqlite_path(uri) is not None
        self.asking = False
        self._outputs = outputs
        self._answered = answered
        self._client: MlflowClient | None = None
        self._experiments: dict[str, str] = {}
        self.closed: dict[str, str] = {}  # places that took no file, and why

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

    def answers(self) -> bool:
        """Tell whether the store answers something."""
        try:
            self.request("search_experiments", max_results=1)
        except (*FAILURES, RefusedError):
            return False
        return True

    def experiment_id(self, name: str) -> str:
        """Find or make an experiment. Raises ExperimentError for one that was deleted."""
        name = shortened(name)
        if name not in self._experiments:
            known = self.request("get_experiment_by_name", name) or self.make_experiment(name)
            if known.lifecycle_stage != ACTIVE:
                place = f"MLFLOW_TRACKING_URI={shlex.quote(redacted(self.uri))}"
                restore = f"{place} mlflow experiments restore --experiment-id {known.experiment_id}"
                take = "tracking.experiment=... takes another"
                raise ExperimentError(f"the experiment {name} was deleted: `{restore}` brings it back, {take}")
            self._experiments[name] = require_id(known.experiment_id)
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
        """The runs with a local id: first what was not deleted, then by what they have.

        There is one, unless an answer was lost or somebody deleted it.
        """
        text = f"tags.`{UID_TAG}` = '{uid}'"
        found = self.request("search_runs", [self.experiment_id(experiment)], text, run_view_type=ViewType.ALL)
        return sorted(
            found, key=lambda run: (deleted(run), -len(run.data.params) - len(run.data.metrics), run.info.run_id)
        )

    def find_or_start(self, experiment: str, entry: Entry, parent: str | None) -> str:
        """MLflow's id of the run that a request started: it is there already, goes on, or is made.

        One that goes on and was deleted does so in a new one, which can be seen.
        """
        found = self.find(experiment, entry["run"])
        if not found and entry["run_id"] and not entry["run_id"].startswith(LOCAL):
            found = self.existing(entry["run_id"])
        if found and not (entry["run_id"] and deleted(found[0])):
            return require_id(found[0].info.run_id)
        if found:
            self.tell("deleted", f"MLflow's run {found[0].info.run_id} was deleted: {entry['name']} is in a new one")
        tags = {**entry["tags"], UID_TAG: entry["run"], **({PARENT_TAG: parent} if parent else {})}
        return require_id(self.make_run(experiment, entry["at"], tags, shortened(entry["name"])).info.run_id)

    def make_run(self, experiment: str, start: int, tags: Mapping[str, str], name: str) -> Run:
        """Make a run. Raises ExperimentError where the experiment was deleted in the meantime."""
        try:
            return self.request("create_run", self.experiment_id(experiment), start, fitting(tags), name)
        except RefusedError as error:
            if DELETED.search(str(error)) or "xperiment" in str(error):
                self._experiments.clear()
                self.experiment_id(experiment)
            raise

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
        params = [Param(key_of(name), shortened(str(value), PARAM_LENGTH)) for name, value in entry["params"].items()]
        for batch in chunks(params, ENTITIES_PER_BATCH):
            self.request("log_batch", run_id, params=batch)

    def tags(self, run_id: str, tags: Mapping[str, str]) -> None:
        """Set tags."""
        for batch in chunks([RunTag(*tag) for tag in fitting(tags).items()], ENTITIES_PER_BATCH):
            self.request("log_batch", run_id, tags=batch)

    def metrics(self, run_id: str, entries: Sequence[Entry]) -> None:
        """Log the numbers of requests."""
        points = [
            Metric(key_of(name), value, entry["at"], entry["step"])
            for entry in entries
            for name, value in entry["values"].items()
        ]
        for batch in chunks(points, METRICS_PER_BATCH):
            self.request("log_batch", run_id, metrics=batch)

    def artifacts(self, run_id: str, directory: Path) -> None:
        """Copy every file of a directory to the run. Raises FilesError where they have no place."""
        send_files(self, run_id, directory)

    def watch_machine(self, run_id: str) -> None:
        """Record the load of this machine, in a thread that ends once the run has or the store is away."""
        from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

        SystemMetricsMonitor(run_id, tracking_uri=with_driver(self.uri)).start()

    def finish(self, experiment: str, run_id: str, entry: Entry) -> None:
        """Close a run, unless it went on after this request; runs that a lost answer made are deleted."""
        for double in self.find(experiment, entry["run"]):
            empty = not double.data.metrics and not double.data.params
            if empty and double.info.run_id != run_id and not deleted(double):
                self.request("delete_run", double.info.run_id)
        run = self.request("get_run", run_id)
        if int(run.data.tags.get(RESUMED_TAG, 0)) <= entry["at"]:
            self.request("set_terminated", run_id, entry["status"], entry["at"])

    def close(self) -> None:
        """Bring all that is stored into the database file itself: empty the write-ahead log of SQLite."""
        if self._client is not None and (database := sqlite_path(self.uri)) is not None:
            with closing(sqlite3.connect(database)) as store:
                store.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def open_client(uri: str, outputs: Path) -> MlflowClient:
    """Connect. One process at a time migrates a fresh SQLite store and sets WAL."""
    for name in ("mlflow", "alembic"):  # migrations are no news
        logging.getLogger(name).setLevel(logging.WARNING)
    database = sqlite_path(uri)
    if database is None:
        return MlflowClient(tracking_uri=uri)
    outputs.mkdir(parents=True, exist_ok=True)
    with FileLock(outputs / ".mlflow.lock", timeout=STORE_LOCK_SECONDS, mode=lock_mode(outputs)):
        database.touch()  # SQLite would let nobody else write, whatever the umask
        with closing(sqlite3.connect(database)) as store:
            store.execute("PRAGMA journal_mode=WAL")
        client = MlflowClient(tracking_uri=with_driver(uri))
        client.get_experiment_by_name("Default")
        return client


def require_id(identifier: str) -> str:
    """An id from an answer. One that broke off after its first line reads as if it were empty."""
    if not identifier:
        raise OSError("the answer broke off")
    return identifier


def deleted(run: Run) -> bool:
    """Tell whether somebody deleted a run; MLflow keeps it, hidden."""
    return str(run.info.lifecycle_stage) != ACTIVE


def fitting(tags: Mapping[str, str]) -> dict[str, str]:
    """Tags of allowed lengths."""
    return {key_of(name): shortened(str(value), TAG_LENGTH) for name, value in tags.items()}
