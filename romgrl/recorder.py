"""MLflow in a process of its own: the pipeline sends what happens, and waits only for what it needs to know.

Importing MLflow takes seconds and sending to it takes the interpreter; neither delays a training here.
"""

from __future__ import annotations

import itertools
import os
import shlex
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

from rich.console import Console

NICENESS = 10  # of the process of MLflow: a training on the same cores goes first
ANSWERED = ("start", "artifacts", "finish")  # requests that the other side answers when they are done


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


def now() -> int:
    """Milliseconds since 1970, as MLflow counts them."""
    return int(time.time() * 1000)


class Recorder:
    """Makes runs in one store, through a process that romgrl.tracking serves; disabled: all runs do nothing."""

    def __init__(self, uri: str, experiment: str, outputs: Path, *, enabled: bool = True) -> None:
        self.uri = uri
        self.users = 1
        self._enabled = enabled
        self._numbers = itertools.count()
        self._answers: dict[int, str | None] = {}
        self._sending, self._receiving = threading.Lock(), threading.Lock()
        self._lost = not enabled
        if enabled:
            self._connection, remote = Pipe()
            self._process = subprocess.Popen(
                [sys.executable, "-m", "romgrl.tracking", str(remote.fileno())],
                pass_fds=[remote.fileno()],
                start_new_session=True,  # an interrupted pipeline still has to say so
            )
            os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)
            remote.close()
            self._connection.send({"uri": uri, "experiment": experiment, "outputs": outputs})

    def start(
        self,
        name: str,
        *,
        parent: RecordedRun | str | None = None,
        tags: Mapping[str, str],
        params: Mapping[str, Any] | None = None,
    ) -> RecordedRun:
        """Start a run with its tags and flattened parameters; `parent` is a run or the id of one."""
        above = parent.number if isinstance(parent, RecordedRun) else parent
        number = self.send("start", None, name, parent=above, tags=dict(tags), params=dict(params or {}), at=now())
        return RecordedRun(self, number)

    def send(self, method: str, run: int | None, *arguments: Any, **named: Any) -> int:
        """Send a request on a run and return the request's number; a run has the number of its start."""
        with self._sending:
            number = next(self._numbers)
            try:
                if not self._lost:
                    self._connection.send((number, run, method, arguments, named))
            except OSError:
                self._lose()
            return number

    def answer(self, number: int) -> str | None:
        """Wait for the answer to a request; None if there will be none."""
        with self._receiving:
            while number not in self._answers and not self._lost:
                try:
                    self._answers.update([self._connection.recv()])
                except (EOFError, OSError):
                    self._lose()
            return self._answers.pop(number, None)

    def close(self) -> None:
        """Let the process go once nobody uses it; runs that are not finished count as killed."""
        self.users -= 1
        if self._enabled and self.users == 0:
            self._lost = True
            self._connection.close()
            self._process.wait()

    def _lose(self) -> None:
        if not self._lost:
            self._lost = True
            Console(stderr=True).print("warning: the process of MLflow ended; going on without", soft_wrap=True)


open_recorders: dict[tuple[str, str, Path, bool], Recorder] = {}


def open_recorder(uri: str | None, experiment: str, outputs: Path, *, enabled: bool) -> Recorder:
    """A recorder of a store, in `outputs` where `uri` is None; the jobs of a sweep use the one of the sweep."""
    settings = (uri or default_uri(outputs), experiment, outputs, enabled)
    recorder = open_recorders.get(settings)
    if recorder is None or recorder.users == 0:
        recorder = open_recorders[settings] = Recorder(*settings[:3], enabled=enabled)
    else:
        recorder.users += 1
    return recorder


class RecordedRun:
    """One run. All is done in the order of the calls; only `run_id`, `artifacts` and `finish` wait for it."""

    def __init__(self, recorder: Recorder, number: int) -> None:
        self.number = number
        self._recorder = recorder
        self._run_id: str | None = None
        self._asked = self._finished = False

    @property
    def run_id(self) -> str | None:
        """MLflow's id of the run; None without tracking."""
        if not self._asked:
            self._asked, self._run_id = True, self._recorder.answer(self.number)
        return self._run_id

    def tags(self, tags: Mapping[str, str]) -> None:
        """Set tags."""
        self._recorder.send("tags", self.number, dict(tags))

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Record numbers at a step."""
        self._recorder.send("metrics", self.number, dict(values), step, at=now())

    def artifacts(self, directory: Path) -> None:
        """Copy every file of a directory to the run."""
        self._recorder.answer(self._recorder.send("artifacts", self.number, directory))

    def finish(self, status: str = "FINISHED") -> None:
        """Close the run once all is stored: FINISHED, FAILED or KILLED."""
        if not self._finished:
            self._finished = True
            self._recorder.answer(self._recorder.send("finish", self.number, status))
