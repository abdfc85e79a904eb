"""What `stage=sync` does: all journals of an output directory brought to their stores, or to the one that is named."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

from romgrl.tracking.journal import HIDDEN, BusyError, JournalError, Outbox, journal_directory, journals, redacted
from romgrl.tracking.recorder import LOCAL, default_uri
from romgrl.tracking.sending.failures import FAILURES, TRIES, ExperimentError, RefusedError, explained
from romgrl.tracking.sending.sender import ParentError, Sender
from romgrl.tracking.sending.store import Store

PAUSE_SECONDS = 0.5  # between two tries of a store that answers other requests
LEFT = ("files", "aside")  # topics of what a store does not take, but may another time


class Sync:
    """All journals of an output directory, to `uri` and `experiment` or, where these are None, to those of each."""

    def __init__(
        self, say: Callable[[str, str], None], *, uri: str | None, experiment: str | None, outputs: Path
    ) -> None:
        self.uri, self.experiment, self.outputs = uri, experiment, outputs
        self._say = say
        self._stores: dict[str, Store] = {}
        self._known: dict[str, dict[str, str]] = {}
        self._away: dict[str, str] = {}
        self._told: dict[tuple[str, str], str] = {}  # by topic and store

    def run(self) -> None:
        """Send what no other process is sending, and say what was brought and what is left."""
        for path in journals(self.outputs):
            try:
                with closing(Outbox(path)) as outbox:
                    self.send(outbox)
            except BusyError as error:
                self._say("text", f"{path.name} {error}")
            except JournalError as error:
                self._say("failure", str(error))
        for uri, store in self._stores.items():
            if uri not in self._away:
                store.close()
        where = journal_directory(self.outputs)
        for (topic, _), text in self._told.items():
            self._say("failure" if topic in LEFT else "text", redacted(text))
        for uri, reason in self._away.items():
            self._say("failure", redacted(f"MLflow at {uri}: {reason}; what is left stays in {where}"))

    def tell(self, uri: str, topic: str, text: str) -> None:
        """Remember the first thing of a topic that a store answered."""
        self._told.setdefault((topic, uri), text)

    def send(self, outbox: Outbox) -> None:
        """Send one journal, unless its store was away before; all of it where it was meant for another place."""
        meant = outbox.uri or default_uri(self.outputs)
        uri = self.uri or meant
        if HIDDEN in uri:
            self._away[uri] = "the journal does not have its password; give tracking.uri"
        if uri in self._away:
            return
        elsewhere = redacted(uri) != meant or self.experiment not in (None, outbox.experiment)
        outbox.experiment = self.experiment or outbox.experiment
        outbox.aim(f"{redacted(uri)} {outbox.experiment}" if elsewhere else "")
        store = self._stores.setdefault(uri, Store(uri, self.outputs, tell=partial(self.tell, uri)))
        sender = Sender(outbox, store, self._known.setdefault(uri, {}))
        try:
            send_all(sender, store)
        except ParentError as error:
            self._say("failure", f"{outbox.path.name}: {error}")
        except ExperimentError as error:
            self.tell(uri, "aside", f"{outbox.path}: {error}")
        except (*FAILURES, RefusedError) as error:
            self._away[uri] = explained(error, uri)
        finally:
            for line in brought_lines(sender):
                self._say("text", redacted(line))


def send_all(sender: Sender, store: Store) -> None:
    """Send a journal; a request that fails while others are answered is tried until it is set aside."""
    for attempt in range(TRIES):
        try:
            while sender.step():
                pass
            sender.end()
            return
        except ExperimentError:
            raise
        except FAILURES:
            if attempt + 1 == TRIES or not store.answers():
                raise
            time.sleep(PAUSE_SECONDS)


def brought_lines(sender: Sender) -> list[str]:
    """What was brought of each run, a line each."""
    lines = []
    for uid, counts in sender.counts.items():
        if uid in sender.known:
            brought = ", ".join(f"{number} {name}" for name, number in counts.items() if number) or "no news"
            status = sender.statuses.get(uid, "still running")
            lines.append(f"{LOCAL}{uid} is {sender.known[uid]}: {brought}, {status}")
    lines += [f"refused by MLflow: {line}" for line in sender.refused]
    if sender.outbox.unreadable:
        lines.append(f"{sender.outbox.path}: {sender.outbox.unreadable} lines cannot be read")
    return lines
