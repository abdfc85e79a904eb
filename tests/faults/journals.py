"""Journals that no process sends."""

from __future__ import annotations

from pathlib import Path

from romgrl.tracking.journal import Journal
from romgrl.tracking.recorder import Recorder, default_uri
from tests.faults.runs import Told


def journaled(outputs: Path, experiment: str = "romgrl") -> tuple[Recorder, Journal]:
    """A recorder with a journal and no process."""
    recorder = Recorder(default_uri(outputs), experiment, outputs, enabled=False)
    recorder.journal = Journal(outputs, {"uri": None, "experiment": experiment})
    return recorder, recorder.journal


def tell(outputs: Path, experiment: str) -> Told:
    """A whole job, into a journal only."""
    recorder, written = journaled(outputs, experiment)
    told = Told(recorder, outputs / "published" / experiment)
    told.start()
    told.steps(0, 4)
    told.finish()
    written.close()
    return told
