"""The process of MLflow as the pipeline sees it: it starts, says what it does, and is waited for with patience."""

from __future__ import annotations

import os
import ssl
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from http.client import HTTPException
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

from romgrl.config.addresses import sqlite_path

BLOCKED_SECONDS = 4.5  # that one job waits in all for a store that does not answer; with all else, 5 at most
ANSWER_SECONDS = 1.0  # a store that answers within this time works, and waiting for it does not count
LONGEST_SECONDS = 120.0  # of one wait for a process that is at work, but does not say what is waited for
FETCH_SECONDS = 600.0  # that the download of one artifact may take
START_SECONDS = 60.0  # that the process may need to start, which is not the store's fault
TICK_SECONDS = 0.1
NICENESS = 10  # of the process: a training on the same cores goes first


class TrackingProcess:
    """Runs `python -m romgrl.tracking.sending`. Threads may wait at the same time."""

    def __init__(
        self,
        settings: Mapping[str, Any],
        *,
        uri: str | None,
        log: Path,
        away: Callable[[str], None] = lambda reason: None,
        warn: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._fetched: dict[str, str] = {}
        self.run_ids: dict[str, str] = {}  # MLflow's, by local id
        self.unmade: set[str] = set()  # local ids of runs that the store does not take
        self.experiment_id: str | None = None
        self.texts: list[str] = []
        self.failure: str | None = None
        self.reason: str | None = None  # why the store is away
        self.alive = True
        self._away, self._warn = away, warn
        self._log = log
        self._changed = threading.Condition()
        self._connection, remote = Pipe()
        with log.open("ab") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "romgrl.tracking.sending", str(remote.fileno())],
                pass_fds=[remote.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=output,  # not the job's, whose reader would wait for a process that goes on after it
                stderr=output,
                start_new_session=True,  # an interrupted pipeline still has to say so
            )
        with suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, NICENESS)
        remote.close()
        self._connection.send(dict(settings))
        self._started = self._heard = time.monotonic()
        self._said_anything = False
        self._in_reach = uri is None or sqlite_path(uri) is not None
        self.renew()
        threading.Thread(target=self._listen, name="mlflow", daemon=True).start()
        if uri is not None and uri.startswith("http"):
            threading.Thread(target=self._probe, args=(uri,), name="mlflow probe", daemon=True).start()

    def renew(self) -> None:
        """Another job begins: it has patience of its own."""
        self.waited = 0.0

    def ask(self) -> None:
        """Let the process look into the journal at once."""
        self._send("look")

    def end(self) -> None:
        """Let the process end once all is sent, or the store does not answer."""
        self._send("end")

    def wait(self, known: Callable[[], bool], *, last: bool = False) -> bool:
        """Wait until something is known; not while the store is away, unless for a `last` try."""
        with self._changed:
            begin = since = time.monotonic()  # `since`: the wait began, or something was heard
            while self.alive and not known() and (last or self.reason is None) and self.waited < BLOCKED_SECONDS:
                self._changed.wait(TICK_SECONDS)
                now = time.monotonic()
                if not last and now - begin >= LONGEST_SECONDS:
                    self._fail(f"at work for {now - begin:.0f} s without an answer")
                elif self._starting(now):
                    since = now
                elif self._heard > since:
                    silence, since = self._heard - since, self._heard
                    self.waited += silence if silence > ANSWER_SECONDS else 0.0
                elif self.waited + now - since >= BLOCKED_SECONDS:
                    self.waited += now - since
                    self._fail("no answer")
            return known()

    def fetch(self, stage: str, key: str, directory: Path) -> str:
        """Have an artifact downloaded to `directory`; none, whole, or why not. A store that is away has none."""
        ticket, answers = uuid.uuid4().hex, self._fetched
        self._send((ticket, stage, key, directory))
        if self.wait(lambda: ticket in answers):
            deadline = time.monotonic() + FETCH_SECONDS
            with self._changed:
                while self.alive and answers[ticket] == "found" and time.monotonic() < deadline:
                    self._changed.wait(TICK_SECONDS)
            return answers[ticket] if answers[ticket] != "found" else "it takes too long"
        return "none"

    def join(self) -> None:
        """Wait for the end of the process, however long it takes; one that ended badly failed."""
        while self.alive:
            with self._changed:
                self._changed.wait(TICK_SECONDS)
        self.failure = self.failure or self.reason

    def kill(self) -> None:
        """End the process at once; what it has not sent stays in the journal."""
        self._process.kill()
        self._process.wait()

    def _starting(self, now: float) -> bool:
        return self._in_reach and not self._said_anything and now - self._started < START_SECONDS

    def _send(self, message: str | tuple[str, str, str, Path]) -> None:
        with suppress(OSError):
            self._connection.send(message)

    def _listen(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                message = self._connection.recv()
                with self._changed:
                    self._take(*message)
                    self._heard, self._said_anything = time.monotonic(), True
                    self._changed.notify_all()
        if code := self._process.wait():
            self._fail(f"its process ended with {code}; {self._log} may say why")
        with self._changed:
            self.alive = False
            self._changed.notify_all()

    def _take(self, kind: str, *values: str) -> None:
        """Take note of a message: beat, answered, run (local id, MLflow's id), fetched (ticket, answer)..."""
        if kind == "away":
            self._fail(*values)
        elif kind == "text":
            self.texts += values
        elif kind == "warning":
            self._warn(*values)
        elif kind == "failure":
            self.failure = "\n".join([self.failure, *values] if self.failure else values)
        elif kind == "experiment":
            (self.experiment_id,) = values
        elif kind in ("answered", "run"):
            self.reason = None
        elif kind == "unmade":
            self.unmade.update(values)
        elif kind == "fetched":
            self._fetched[values[0]] = values[1]
        if kind == "run":
            self.run_ids[values[0]] = values[1]

    def _fail(self, reason: str) -> None:
        self.reason = reason
        self._away(reason)

    def _probe(self, uri: str) -> None:
        """Ask a server whether it is there while the process still starts."""
        try:
            urllib.request.urlopen(f"{uri.rstrip('/')}/health", timeout=BLOCKED_SECONDS).close()
        except urllib.error.HTTPError:
            pass  # an answer, too
        except (OSError, HTTPException, ValueError) as error:
            if not self._said_anything and not isinstance(getattr(error, "reason", error), ssl.SSLError):
                self._fail(str(error))
                return
        self._in_reach = True
