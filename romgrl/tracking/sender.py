"""From a journal to a store: request by request, in order, again from the last mark after whatever went wrong."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from pathlib import Path

from romgrl.journal import Entry, Outbox, starts_run
from romgrl.recorder import LOCAL
from romgrl.tracking.store import RefusedError, Store

LOCAL_ID = re.compile(LOCAL + "[0-9a-f]{32}")


class ParentError(Exception):
    """The run above another one is not in the store yet, but a journal has it."""


class Sender:
    """Sends one journal to a store. Raises FAILURES where that is away."""

    def __init__(self, outbox: Outbox, store: Store, known: dict[str, str]) -> None:
        self.outbox = outbox
        self.known = known  # MLflow's ids by local id
        self.counts: dict[str, Counter[str]] = {}
        self.statuses: dict[str, str] = {}
        self.refused: list[str] = []
        self.starts: dict[str, Entry] = {}
        self._store = store
        self._last = 0
        for entry in outbox.sent():
            self._note(entry)

    @property
    def left(self) -> bool:
        """Tell whether there is something to send."""
        return bool(self.outbox.read()[0])

    def step(self) -> bool:
        """Send the next piece; False if there is none."""
        entries, end = self.outbox.read()
        metrics: dict[str, list[Entry]] = {}
        for entry in entries:
            if entry["do"] == "metrics":
                metrics.setdefault(entry["run"], []).append(entry)
            else:
                self._send_metrics(metrics.pop(entry["run"], []))
                self._send(entry)
            self._note(entry)
        for remaining in metrics.values():
            self._send_metrics(remaining)
        if end > self.outbox.offset:
            self.outbox.mark(end)
            return True
        return False

    def end(self) -> bool:
        """Close what the job left open and delete the journal; False while the job lives."""
        if not self.outbox.job_ended() or self.step():
            return False
        for uid in [uid for uid in self.starts if uid not in self.statuses]:
            self._send({"do": "finish", "run": uid, "at": self._last, "status": "KILLED"})
            self.statuses[uid] = "KILLED"
        self.outbox.delete()
        return True

    def _note(self, entry: Entry) -> None:
        self._last = entry["at"]
        if entry["do"] == "start":
            self.starts[entry["run"]] = entry
            self.statuses.pop(entry["run"], None)
        elif entry["do"] == "finish":
            self.statuses[entry["run"]] = entry["status"]

    def _run_id(self, uid: str) -> str | None:
        """MLflow's id of a run of this journal, which is made where it is not there; None without a start."""
        start = self.starts.get(uid)
        if uid not in self.known and start is not None:
            self.known[uid] = self._store.find_or_start(self.outbox.experiment, start, self._parent(start["parent"]))
        return self.known.get(uid) if start is not None else None

    def _parent(self, parent: str | None) -> str | None:
        if parent is None or not parent.startswith(LOCAL):
            return parent
        awaited = starts_run(self.outbox.path.parent, parent.removeprefix(LOCAL))
        run_id = self._resolve(parent)
        if run_id is None and awaited:
            raise ParentError("the run above is not in the store yet")
        return run_id

    def _resolve(self, local: str) -> str | None:
        """MLflow's id for a local one, if the store has it."""
        uid = local.removeprefix(LOCAL)
        if uid in self.starts:
            return self._run_id(uid)
        if uid not in self.known:
            for run in self._store.find(self.outbox.experiment, uid)[:1]:
                self.known[uid] = run.info.run_id
        return self.known.get(uid)

    def _named(self, text: str) -> str:
        """A text with MLflow's ids in the place of local ones."""
        return LOCAL_ID.sub(lambda found: self._resolve(found[0]) or found[0], text)

    def _send(self, entry: Entry) -> None:
        do, uid = entry["do"], entry["run"]
        if do == "start":
            self._note(entry)
        run_id = self._run_id(uid)
        counts = self.counts.setdefault(uid, Counter())
        if run_id is None:
            self.refused.append(f"{do}: its run has no start")
            return
        try:
            if do == "start":
                self._store.describe(run_id, entry)
                counts["params"] += len(entry["params"])
            elif do == "tags":
                self._store.tags(run_id, {name: self._named(value) for name, value in entry["tags"].items()})
                counts["tags"] += len(entry["tags"])
            elif do == "artifacts":
                self._store.artifacts(run_id, Path(entry["directory"]))
                counts["artifact directories"] += 1
            else:
                self._store.finish(self.outbox.experiment, run_id, entry)
        except RefusedError as error:
            self.refused.append(f"{do}: {error}")

    def _send_metrics(self, entries: list[Entry]) -> None:
        run_id = self._run_id(entries[0]["run"]) if entries else None
        if run_id is None:
            return
        self.counts.setdefault(entries[0]["run"], Counter())["metrics"] += sum(len(e["values"]) for e in entries)
        with suppress(RefusedError):
            self._store.metrics(run_id, entries)
