"""Checkpoints of a running training: when they are written, where it goes on, and how a signal ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path

from romgrl.artifacts.checkpoint import CHECKPOINT, Checkpoints, Ring
from romgrl.errors import ArtifactError, DivergenceError
from romgrl.runtime import signals
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.training.restoring import Stateful, restore_all

__all__ = ["Stateful", "TrainingCheckpoints"]


class TrainingCheckpoints:
    """Keeps the state of all `parts` of a training of `total()` steps in its workspace `output`.

    `save_policy` writes what can be used at once; `seconds` of work lie between two checkpoints; `ring` is the replay
    buffer, the rows of which are no part of its state.
    """

    def __init__(
        self,
        output: Path,
        parts: Mapping[str, Stateful],
        *,
        save_policy: Callable[[], None],
        seconds: float,
        total: Callable[[], int],
        log: StageLog,
        ring: Ring | None = None,
    ) -> None:
        self._checkpoints = Checkpoints(output / CHECKPOINT, ring=ring, say=log.message)
        self._parts, self._save_policy = parts, save_policy
        self._seconds, self._total, self._log = seconds, total, log
        self._saved = time.monotonic()
        self._step = 0

    def resume(self) -> int:
        """Restore the newest checkpoint and return its step; 0 where there is none."""
        fresh = deepcopy({name: part.state() for name, part in self._parts.items()})
        while found := self._checkpoints.load():
            step, state = found
            try:
                restore_all(self._parts, state, fresh)
                self._checkpoints.require_rows()
            except ArtifactError as error:
                for name, part in self._parts.items():
                    part.restore(deepcopy(fresh[name]))
                self._checkpoints.refuse(step, str(error))
                continue
            self._step = step
            self._log.resumed(step)
            self._log.message(f"goes on at step {step:,} of {self._total():,}")
            self._saved = time.monotonic()
            return step
        if self._checkpoints.directory.is_dir():
            self._log.resumed(0)  # all that there was is set aside: the curve begins again, too
        return 0

    @contextmanager
    def deferring_signals(self, stage: str) -> Iterator[None]:
        """Keep signals back for `save_if_due`, and tell after which step a training left the finite numbers."""
        try:
            with signals.deferred():
                yield
        except DivergenceError as error:
            raise DivergenceError(
                f"{stage}: {error}, after step {self._step:,}; the last checkpoint is kept"
            ) from error

    def save_if_due(self, step: int) -> None:
        """Write a checkpoint where one is due; where a signal has come, write it and raise Interrupted."""
        self._step = step
        pending = signals.pending()
        if pending or time.monotonic() - self._saved >= self._seconds:
            self._save_policy()
            self._checkpoints.save(step, {name: part.state() for name, part in self._parts.items()})
            self._saved = time.monotonic()
        if pending:
            self._log.message(f"interrupted at step {step:,} of {self._total():,}; the same command goes on there")
            signals.raise_pending()
