"""From a journal to a store: request by request, in order, again from the last mark after whatever went wrong.

What the store does not take while it answers all else holds nothing back: it is set aside and sent again at the end.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from romgrl.tracking.journal import Entry, Outbox, starts_run
from romgrl.tracking.recorder import LOCAL
from romgrl.tracking.sending.failures import (
    DELETED,
    FAILURES,
    ExperimentError,
    FilesError,
    RefusedError,
    explained,
    tries_of,
)
from romgrl.tracking.sending.files import explain_files, mark_found, mark_missing
from romgrl.tracking.sending.store import Store

COUNTED = {"start": "params", "artifacts": "artifact directories"}  # how the counts are called where not as the request
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
        self._unmade: dict[str, str] = {}  # runs that the store would not make, and why
        self._failed: Counter[tuple[object, ...]] = Counter()  # tries of a request that were answered otherwise
        self._ended = False
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
        """Close what the job left open, and delete the journal if nothing is left; False while the job lives."""
        if not self.outbox.job_ended() or self.step():
            return False
        for uid in [uid for uid in self.starts if uid not in self.statuses]:
            self._send({"do": "finish", "run": uid, "at": self._last, "status": "KILLED"})
            self.statuses[uid] = "KILLED"
        if not self._ended:
            self._unmade.clear()
            self._failed.clear()
            self.outbox.keep_left([entry for entry in self.outbox.left() if not self._send(entry, judged=True)])
            self._ended = True
        if not self.outbox.left():
            self.outbox.delete()
        return True

    @property
    def unmade(self) -> set[str]:
        """Local ids of the runs that the store does not take: their job need not wait for them."""
        return set(self._unmade)

    def name_sent(self) -> None:
        """Learn MLflow's ids of runs that another process has sent: their job waits for them."""
        for uid in self.starts.keys() - self.known.keys():
            self._run_id(uid)

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
        if uid not in self.known and uid not in self._unmade and start is not None:
            try:
                parent = self._parent(start["parent"])
                self.known[uid] = self._store.find_or_start(self.outbox.experiment, start, parent)
            except ExperimentError:
                raise
            except (*FAILURES, RefusedError) as error:
                if not self._is_aside(start, error):
                    raise
                self._unmade[uid] = explained(error, self._store.uri)
        return self.known.get(uid) if start is not None else None

    def _parent(self, parent: str | None) -> str | None:
        if parent is None or not parent.startswith(LOCAL):
            return parent
        uid, directory = parent.removeprefix(LOCAL), self.outbox.path.parent
        awaited = starts_run(directory, uid) and not starts_run(directory, uid, among="*.left")
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

    def _is_aside(self, entry: Entry, error: BaseException, *, judged: bool = False) -> bool:
        """Tell whether a request that failed is to hold nothing back: the store answers, but never this one.

        `judged`: it was so before, or others that it was sent with.
        """
        if isinstance(error, RefusedError | FilesError):
            return True
        tries, what = tries_of(entry["do"], error), (entry["run"], entry["do"], entry["at"])
        self._failed[what] += 1
        return tries is not None and (judged or self._failed[what] >= tries) and self._store.answers()

    def _send(self, entry: Entry, *, judged: bool = False) -> bool:
        """Send a request; False if it was set aside."""
        do, uid = entry["do"], entry["run"]
        if do == "start" and not judged:  # one that was left is known, and its run may have ended since
            self._note(entry)
        run_id = self._run_id(uid)
        counts = self.counts.setdefault(uid, Counter())
        if run_id is None:
            if uid in self._unmade:
                return self._set_aside(entry, self._unmade[uid])
            self.refused.append(f"{do}: its run has no start")
            return True
        try:
            counts[COUNTED.get(str(do), str(do))] += self._deliver(entry, run_id)
        except RefusedError as error:
            self._refuse(entry, str(error))
        except (*FAILURES, FilesError) as error:
            if not self._is_aside(entry, error, judged=judged):
                raise
            if do == "artifacts":
                return self._set_files_aside(entry, run_id, error)
            return self._set_aside(entry, explained(error, self._store.uri))
        return True

    def _deliver(self, entry: Entry, run_id: str) -> int:
        """Have the store do what a request asks for; returns how many things that were."""
        do = entry["do"]
        if do == "start":
            self._store.describe(run_id, entry)
            return len(entry["params"])
        if do == "tags":
            self._store.tags(run_id, {name: self._named(value) for name, value in entry["tags"].items()})
            return len(entry["tags"])
        if do == "artifacts":
            self._store.artifacts(run_id, Path(entry["directory"]))
            if self._ended or self.outbox.left():
                mark_found(self._store, run_id)
            return 1
        if do == "metrics":
            self._store.metrics(run_id, [entry])
            return len(entry["values"])
        self._store.finish(self.outbox.experiment, run_id, entry)
        return 0

    def _send_metrics(self, entries: list[Entry], *, judged: bool = False) -> None:
        """Send the numbers of a run at once; those of fewer and fewer calls where the store does not take them."""
        run_id = self._run_id(entries[0]["run"]) if entries else None
        if run_id is None or len(entries) < 2:
            for entry in entries:
                self._send(entry, judged=judged)
            return
        try:
            self._store.metrics(run_id, entries)
        except (*FAILURES, RefusedError) as error:
            if not self._is_aside(entries[0], error, judged=judged):
                raise
            if DELETED.search(str(error)):
                for entry in entries:
                    self._refuse(entry, str(error))
            else:
                self._send_metrics(entries[: len(entries) // 2], judged=True)
                self._send_metrics(entries[len(entries) // 2 :], judged=True)
            return
        self.counts.setdefault(entries[0]["run"], Counter())["metrics"] += sum(len(e["values"]) for e in entries)

    def _title(self, entry: Entry) -> str:
        return str(self.starts[entry["run"]]["name"]) if entry["run"] in self.starts else "a run"

    def _refuse(self, entry: Entry, why: str) -> None:
        """Say that the store will never take a request, and keep it beside the journal."""
        self.refused.append(f"{entry['do']}: {why}")
        self.outbox.refuse(entry)
        name, kept = self._title(entry), f"kept in {self.outbox.refused_path}"
        if DELETED.search(why):
            self._store.tell("deleted", f"the run of {name} was deleted in MLflow, which takes no more of it; {kept}")
        elif entry["do"] != "artifacts":  # they are gone from this disk
            self._store.tell("refused", f"MLflow refuses {entry['do']} of {name} ({why}); all else goes on; {kept}")

    def _set_aside(self, entry: Entry, why: str) -> bool:
        self.outbox.set_aside(entry)
        text = f"MLflow does not take {entry['do']} of {self._title(entry)} ({why}); all else goes on"
        self._store.tell("aside", f"{text}; kept in {self.outbox.left_path} for stage=sync")
        return False

    def _set_files_aside(self, entry: Entry, run_id: str, error: BaseException) -> bool:
        self.outbox.set_aside(entry)
        why = str(error) if isinstance(error, FilesError) else explain_files(self._store, run_id, error)
        mark_missing(self._store, run_id, Path(entry["directory"]))
        text = f"MLflow at {self._store.uri} does not take files: {why}"
        self._store.tell("files", f"{text}; all else goes on, and stage=sync tries the files again")
        return False
