"""Where a stage works until its artifact is whole; what it needs to go on from survives the end of its process."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import suppress
from pathlib import Path

from romgrl.artifacts import MANIFEST
from romgrl.artifacts.checkpoint import CHECKPOINT


class Workspace:
    """`<key>.partial`, beside it while it is published `<key>.checkpoint`, and the note of the attempts so far.

    The name is the stage key, so what lies there was made from the same configuration, code and upstream artifacts.
    """

    def __init__(self, directory: Path) -> None:
        self.partial = directory.with_name(f"{directory.name}.partial")
        self._checkpoint = self.partial / CHECKPOINT
        self._aside = directory.with_name(f"{directory.name}.checkpoint")
        self._note = directory.with_name(f".{directory.name}.attempt")
        self.run_id: str | None = None
        self.seconds = 0.0

    def open(self) -> bool:
        """Keep what an interrupted attempt left, or begin with nothing; tell whether there is a state to go on from."""
        if self._aside.exists():
            shutil.rmtree(self._checkpoint, ignore_errors=True)
            self.partial.mkdir(parents=True, exist_ok=True)
            os.replace(self._aside, self._checkpoint)
        goes_on = self._checkpoint.is_dir()
        if goes_on:
            (self.partial / MANIFEST).unlink(missing_ok=True)
            self._read_note()
        else:
            shutil.rmtree(self.partial, ignore_errors=True)
            self.partial.mkdir(parents=True)
        return goes_on

    def note(self, run_id: str | None, seconds: float) -> None:
        """Write down the MLflow run and the time worked so far, for the next attempt."""
        with suppress(OSError):  # it is written when something has failed, which is the fault to tell
            self._note.write_text(json.dumps({"run_id": run_id, "seconds": seconds}), encoding="utf-8")

    def _read_note(self) -> None:
        try:
            noted = json.loads(self._note.read_text(encoding="utf-8"))
            self.run_id, self.seconds = noted["run_id"], float(noted["seconds"])
        except (OSError, ValueError, KeyError, TypeError):
            return  # a lost note costs a line in MLflow, not the training

    def clear_checkpoint(self) -> None:
        """Take the checkpoint out of what is published; it stays beside it until that has happened."""
        if self._checkpoint.is_dir():
            os.replace(self._checkpoint, self._aside)

    def close(self) -> None:
        """The artifact is published; whoever may not remove what is left lets it lie."""
        shutil.rmtree(self._aside, ignore_errors=True)
        with suppress(OSError):
            self._note.unlink(missing_ok=True)

    @property
    def places(self) -> tuple[Path, ...]:
        """What an attempt writes to or takes away, where it is there."""
        return self.partial, self._checkpoint, self._aside
