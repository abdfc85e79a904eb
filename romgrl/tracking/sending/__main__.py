"""The process of MLflow: it sends the journal of its job, then those that earlier jobs left, or all of them for a sync.

Tracking never costs a training: what fails is told and tried again, and stays in the journal until the store has it.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import closing, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from romgrl.errors import RomgrlError
from romgrl.runtime.display import protect
from romgrl.tracking.journal import BusyError, JournalError, Outbox, journals, redacted
from romgrl.tracking.recorder import SYSTEM_METRICS, default_uri
from romgrl.tracking.sending.failures import FAILURES, ExperimentError, RefusedError, explained
from romgrl.tracking.sending.fetching import download, find_run
from romgrl.tracking.sending.sender import ParentError, Sender
from romgrl.tracking.sending.store import Store
from romgrl.tracking.sending.syncing import Sync

POLL_SECONDS = 1.0  # between two looks into the journal
RETRY_SECONDS = (0.5, 8.0)  # between two tries of a store that is away: at first, and at most
BEAT_SECONDS = 0.25
MOMENT = 0.01
OF_ONE_JOURNAL = (BusyError, JournalError, ParentError, RefusedError, ExperimentError)  # the next one may be sent
DETACHED_SECONDS = 600.0  # that the process goes on after its job, while the store answers


class Link:
    """The pipe to the pipeline, which may be gone. A beat says: at work, and not waiting for anybody."""

    def __init__(self, connection: Connection) -> None:
        self.at_work = True
        self.store: Store | None = None
        self.wanted: list[tuple[str, str, str, Path]] = []  # ticket, stage, key and where to download it to
        self._connection = connection
        self._sending = threading.Lock()
        threading.Thread(target=self._beat, name="beat", daemon=True).start()

    def say(self, *message: str) -> None:
        """Send a message."""
        with self._sending, suppress(OSError):
            self._connection.send(message)

    def hear(self, seconds: float) -> bool:
        """Wait for a word of the pipeline, and keep what it asks for; True once it has no more to say or is gone."""
        try:
            word = self._connection.recv() if self._connection.poll(seconds) else None
        except (EOFError, OSError):
            return True
        if isinstance(word, tuple):
            self.wanted.append(word)
        return word == "end"

    def _beat(self) -> None:
        while True:
            if self.at_work and (self.store is None or self.store.on_disk or not self.store.asking):
                self.say("beat")
            time.sleep(BEAT_SECONDS)


class Live:
    """The journal of a live job, and those that earlier ones left for the same store."""

    def __init__(self, link: Link, outbox: Outbox, *, uri: str, outputs: Path) -> None:
        self.link, self.outputs = link, outputs
        self._topics: set[str] = set()
        self.store = link.store = Store(uri, outputs, answered=lambda: link.say("answered"), tell=self.tell)
        self.known: dict[str, str] = {}
        self._own = Sender(outbox, self.store, self.known)
        self._told: set[str] = set()
        self._retry = RETRY_SECONDS[0]
        self._looked_at: set[Path] = {outbox.path}

    def tell(self, topic: str, text: str) -> None:
        """Let the pipeline say something, once for each topic; it may be gone, the log is not."""
        if topic not in self._topics:
            self._topics.add(topic)
            print(redacted(text), flush=True)
            self.link.say("warning", redacted(text))

    def serve(self) -> None:
        """Send what there is until the job has ended and the store has all, or does not answer any more."""
        while not self.link.hear(self.attempt(ended=False) or MOMENT):
            self.fetch_wanted()
        deadline = time.monotonic() + DETACHED_SECONDS
        while (seconds := self.attempt(ended=True)) is not None and time.monotonic() < deadline:
            time.sleep(seconds)
        with suppress(*FAILURES):
            self.store.close()

    def fetch_wanted(self) -> None:
        """Download what the pipeline asks for, and answer: none, or found and then whole or why not."""
        while self.link.wanted:
            ticket, stage, key, directory = self.link.wanted.pop()
            try:
                run_id = find_run(self.store, self._own.outbox.experiment, stage, key)
            except (*FAILURES, RefusedError) as error:
                self.link.say("away", redacted(explained(error, self.store.uri)))
                run_id = None
            self.link.say("fetched", ticket, "found" if run_id else "none")
            if run_id:
                self.link.say("fetched", ticket, self.download(run_id, directory))

    def download(self, run_id: str, directory: Path) -> str:
        """Download an artifact; whole, or why not."""
        try:
            download(self.store, run_id, directory)
        except (*FAILURES, RefusedError, RomgrlError) as error:
            return redacted(explained(error, self.store.uri))
        return "whole"

    def attempt(self, *, ended: bool) -> float | None:
        """Send a piece, and tell how long to wait before the next; None where a job that has ended can go."""
        try:
            moved = self.step(ended=ended)
            self.link.at_work, self._retry = True, RETRY_SECONDS[0]
            return MOMENT if moved else None if ended else POLL_SECONDS
        except ParentError:
            self.link.at_work = False
            return POLL_SECONDS
        except (*FAILURES, RefusedError) as error:
            self.link.say("away", redacted(explained(error, self.store.uri)))
            seconds, self._retry = self._retry, min(2 * self._retry, RETRY_SECONDS[1])
            return None if ended else seconds

    def step(self, *, ended: bool) -> bool:
        """Send a piece; False if there is no more to send."""
        moved = self._own.step()
        self._own.name_sent()
        for uid in self._own.starts.keys() & self.known.keys() - self._told:
            self._told.add(uid)
            self.link.say("experiment", self.store.experiment_id(self._own.outbox.experiment))
            self.link.say("run", uid, self.known[uid])
            if SYSTEM_METRICS in self._own.starts[uid]["tags"]:
                self.store.watch_machine(self.known[uid])
        for uid in self._own.unmade - self._told:
            self._told.add(uid)
            self.link.say("unmade", uid)
        if ended:
            return not self._own.end()
        return moved or self.send_older()

    def send_older(self) -> bool:
        """Send some of a journal that an earlier job left for the same store; False if there is none."""
        for path in journals(self.outputs):
            if path not in self._looked_at:
                self._looked_at.add(path)
                with suppress(*OF_ONE_JOURNAL), closing(Outbox(path)) as outbox:
                    if (outbox.uri or default_uri(self.outputs)) == redacted(self.store.uri):
                        outbox.aim()
                        if self.send(Sender(outbox, self.store, self.known)):
                            self._looked_at.remove(path)
                        return True
        return False

    def send(self, older: Sender) -> bool:
        """Send an older journal until the own one has news; True if something is left."""
        while older.step():
            if self._own.left:
                return True
        older.end()
        return False


def own_outbox(path: Path, link: Link) -> Outbox | None:
    """The outbox of the own journal, once no other process sends it; None if that one has sent it to its end."""
    while path.exists():
        try:
            outbox = Outbox(path)
        except BusyError:
            link.at_work = False  # a process that stands still must not hold up the end of the job
            time.sleep(POLL_SECONDS)
        else:
            link.at_work = True
            return outbox
    return None


def serve(connection: Connection) -> None:
    """Do what the settings that come over the pipe ask for."""
    link = Link(connection)
    settings: Mapping[str, Any] = connection.recv()
    uri, outputs, journal = (settings[name] for name in ("uri", "outputs", "journal"))
    if journal is None:
        Sync(link.say, uri=uri, experiment=settings["experiment"], outputs=outputs).run()
    elif (outbox := own_outbox(journal, link)) is not None:
        Live(link, outbox, uri=uri, outputs=outputs).serve()


def main() -> None:
    """Serve the pipe whose file descriptor is the only argument; signals are the pipeline's to answer."""
    protect()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    serve(Connection(int(sys.argv[1])))
    os._exit(0)  # all is stored; taking MLflow apart would be half a second for nothing


if __name__ == "__main__":
    main()
