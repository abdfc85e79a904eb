"""Runs of MLflow as the pipeline records them: every request goes to a journal first, and training waits for none.

Importing MLflow takes seconds and a tracking server may be away; neither delays a training. A process of its own sends
what the journal has; what it could not bring, `python -m romgrl stage=sync` or the next job does.
"""

from __future__ import annotations

import shlex
import shutil
import sys
import time
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from romgrl.artifacts import require_right
from romgrl.config.addresses import as_typed, sqlite_address, sqlite_path
from romgrl.errors import TrackingError
from romgrl.runtime.surroundings import proxy_note
from romgrl.tracking.journal import Journal, journal_directory, journals, redacted
from romgrl.tracking.process import TrackingProcess

LOCAL = "local:"  # before the id of a run that MLflow has not named yet
NOTE = "mlflow.note.content"  # the tag of a description, which the UI shows as Markdown
SYSTEM_METRICS = "romgrl.system_metrics"  # the tag of a run that gets the load of its machine
UI_ADDRESS = "http://127.0.0.1:5000"  # of the command of `ui_command`
JOBS = "workflowType=machine_learning&searchFilter=tags.stage%3D%22job%22&orderByAsc=false"
LOG = "tracking.log"  # beside the journals: what the process of MLflow would print


def default_uri(outputs: Path) -> str:
    """The SQLite store of an output directory."""
    return sqlite_address(outputs.resolve() / "mlflow.db")


def ui_command(uri: str) -> str:
    """The command that shows the runs of a store on this machine; the server listens on loopback only."""
    if uri.startswith("http"):
        return f"open {redacted(uri)}"
    beside_python = Path(sys.executable).with_name("mlflow")
    own = shutil.which("mlflow") == str(beside_python) or not beside_python.exists()
    program = "mlflow" if own else shlex.quote(str(beside_python))  # another one may not know this store
    return f"{program} ui --backend-store-uri {shlex.quote(redacted(uri))} --host 127.0.0.1"


def jobs_address(uri: str, experiment_id: str, best: str) -> str:
    """Where MLflow's UI lists the jobs of an experiment, the one with the most of the metric `best` first.

    Only by a metric: sorted by time they hide below their sweeps. Without the type of workflow the UI opens the traces
    of language models.
    """
    start = redacted(uri).rstrip("/") if uri.startswith("http") else UI_ADDRESS
    return f"{start}/#/experiments/{experiment_id}/runs?{JOBS}&orderByKey=metrics.%60{best}%60"


def now() -> int:
    """Milliseconds since 1970, as MLflow counts them."""
    return int(time.time() * 1000)


def warn(text: str) -> None:
    """Say what is lost or late, in one line."""
    Console(stderr=True).print(f"warning: {text}", soft_wrap=True, markup=False, highlight=False)


def flatten_params(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested mappings to dotted names."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= flatten_params(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {prefix + name: value}
    return flat


def is_bare(directory: Path) -> bool:
    """Tell whether a directory has no directories, or is not there."""
    return not directory.is_dir() or not any(path.is_dir() for path in directory.iterdir())


class Recorder:
    """Makes runs in one store; disabled: all runs do nothing. No method raises because of the store or the journal."""

    def __init__(self, uri: str, experiment: str, outputs: Path, *, enabled: bool = True) -> None:
        self.uri = uri
        self.users = 1
        database = sqlite_path(uri)
        self._has_a_past = database is not None and database.is_file()
        self._outputs = outputs
        self._told: set[str] = set()
        self.journal: Journal | None = None
        self.process: TrackingProcess | None = None
        if enabled:
            kept = None if uri == default_uri(outputs) else redacted(uri)
            log = journal_directory(outputs) / LOG
            try:
                self.journal = Journal(outputs, {"uri": kept, "experiment": experiment})
                settings = {"uri": uri, "outputs": outputs, "journal": self.journal.path}
                self.process = TrackingProcess(settings, uri=uri, log=log, away=self._away, warn=warn)
            except OSError as error:
                place = log if error.filename == str(log) else journal_directory(outputs)
                self._tell("journal", f"nothing goes to MLflow: {place}: {error.strerror or error}")

    @property
    def lost(self) -> bool:
        """Tell whether the process of MLflow is gone."""
        return self.process is not None and not self.process.alive

    @property
    def experiment_id(self) -> str | None:
        """MLflow's id of the experiment; None until the store has told one of its runs."""
        return self.process.experiment_id if self.process is not None else None

    def start(
        self,
        name: str,
        *,
        parent: RecordedRun | str | None = None,
        tags: Mapping[str, str],
        params: Mapping[str, Any] | None = None,
        run_id: str | None = None,
    ) -> RecordedRun:
        """Start a run with its tags and flattened parameters, or go on in the run `run_id` if the store has it.

        `parent` is a run or the id of one; ids are MLflow's or local ones.
        """
        uid = run_id.removeprefix(LOCAL) if run_id and run_id.startswith(LOCAL) else uuid.uuid4().hex
        run = RecordedRun(self, uid)
        run.request(
            "start",
            name=redacted(name),
            parent=parent.local_id if isinstance(parent, RecordedRun) else parent,
            tags=dict(tags),
            params={name: redacted(str(value)) for name, value in flatten_params(params or {}).items()},
            run_id=run_id,
        )
        return run

    def append(self, uid: str, method: str, **fields: Any) -> None:
        """Write a request on a run down. A full disk is told once; training goes on."""
        if self.journal is None:
            return
        try:
            self.journal.append({"run": uid, "do": method, "at": now(), **fields})
        except OSError as error:
            self._tell("journal", f"not everything goes to MLflow: {self.journal.path}: {error}")

    def run_id(self, uid: str) -> str | None:
        """MLflow's id of a run if the store tells it in time, or its local id; None without tracking."""
        if self.journal is None or self.process is None:
            return None
        known = self.process.run_ids
        if uid not in known:
            self.process.ask()
            unmade = self.process.unmade
            self.process.wait(lambda: uid in known or uid in unmade)
        return known.get(uid, LOCAL + uid)

    def fetch(self, stage: str, key: str, directory: Path) -> bool:
        """Download the artifact of a stage key from MLflow to `directory`, unverified; False if it has none.

        A server that is away has none. What a store on this disk has is on this disk, too, unless all artifacts of the
        stage were removed.
        """
        asked = self.uri.startswith("http") or (self._has_a_past and is_bare(directory.parent))
        if self.process is None or not asked:
            return False
        answer = self.process.fetch(stage, key, directory)
        if answer not in ("whole", "none"):
            warn(f"{stage}: cannot be fetched from MLflow at {redacted(self.uri)}: {answer}")
        return answer == "whole"

    def close(self) -> None:
        """Wait for the store once nobody records any more; runs that are not finished count as killed.

        The process sends the rest alone, as long as the store answers.
        """
        self.users -= 1
        if self.journal is None or self.process is None or self.users > 0:
            return
        self.journal.close()
        self.process.end()
        self.process.wait(lambda: False, last=True)
        if self.journal.path.exists():
            self._tell(
                "rest",
                f"MLflow at {redacted(self.uri)} does not have everything yet; kept in {self.journal.path}: "
                f"python -m romgrl stage=sync {as_typed('paths.outputs', str(self._outputs))} brings the rest",
            )

    def _away(self, reason: str) -> None:
        why = redacted(reason) + proxy_note(self.uri)
        self._tell("away", f"MLflow at {redacted(self.uri)} failed ({why}); going on, everything is kept")

    def _tell(self, topic: str, text: str) -> None:
        if topic not in self._told:
            self._told.add(topic)
            warn(text)


open_recorders: dict[tuple[str, str, Path, bool], Recorder] = {}


def open_recorder(uri: str | None, experiment: str, outputs: Path, *, enabled: bool) -> Recorder:
    """A recorder of a store, in `outputs` where `uri` is None; the jobs of a sweep use the one of the sweep."""
    settings = (uri or default_uri(outputs), experiment, outputs, enabled)
    recorder = open_recorders.get(settings)
    if recorder is None or recorder.users == 0 or recorder.lost:
        recorder = open_recorders[settings] = Recorder(*settings[:3], enabled=enabled)
    else:
        recorder.users += 1
        if recorder.process is not None:
            recorder.process.renew()
    return recorder


class RecordedRun:
    """One run. All is done in the order of the calls; only `run_id` may wait."""

    def __init__(self, recorder: Recorder, uid: str) -> None:
        self.local_id = LOCAL + uid
        self._uid = uid
        self._recorder = recorder
        self._finished = False

    @property
    def run_id(self) -> str | None:
        """MLflow's id of the run; `local:...` while the store has not told it; None without tracking."""
        return self._recorder.run_id(self._uid)

    def request(self, method: str, **fields: Any) -> None:
        """Write a request on this run down."""
        self._recorder.append(self._uid, method, **fields)

    def tags(self, tags: Mapping[str, str]) -> None:
        """Set tags."""
        self.request("tags", tags=dict(tags))

    def describe(self, text: str) -> None:
        """Set the description, in Markdown."""
        self.tags({NOTE: redacted(text)})

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Record numbers at a step."""
        self.request("metrics", values={name: float(value) for name, value in values.items()}, step=int(step))

    def artifacts(self, directory: Path) -> None:
        """Copy every file of a directory to the run, some time later: it must stay where it is."""
        self.request("artifacts", directory=str(directory))

    def finish(self, status: str = "FINISHED") -> None:
        """Close the run once all is stored: FINISHED, FAILED or KILLED."""
        if not self._finished:
            self._finished = True
            self.request("finish", status=status)


def bring_journals(uri: str | None, outputs: Path, experiment: str | None = None) -> list[str]:
    """Bring what earlier jobs could not to `uri`, or to the store of each where it is None; returns a line per run.

    The same for the experiment; a place that a job was not meant for gets all that its journal has.

    Raises TrackingError if something is left, ConfigurationError where this user may not send it.
    """
    if not journals(outputs):
        return ["nothing is left to bring to MLflow"]
    for place in (journal_directory(outputs), journal_directory(outputs) / LOG):
        require_right(place, "what is left to bring to MLflow is sent from there")
    settings = {"uri": uri, "experiment": experiment, "outputs": outputs, "journal": None}
    process = TrackingProcess(settings, uri=uri, log=journal_directory(outputs) / LOG)
    try:
        process.join()
    finally:
        process.kill()
    if process.failure is not None:
        raise TrackingError("\n".join([*process.texts, redacted(process.failure) + proxy_note(uri or "")]))
    return process.texts or ["nothing is left to bring to MLflow"]
