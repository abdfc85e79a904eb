"""How much of its budget a training has used: environment steps, and wall time where it is limited."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


def over_the_middle(first: float, last: float | None, share: float) -> float:
    """From `first` straight to `last` over the middle half of a training, at a share of it; None: as it was."""
    return first if last is None else first + (last - first) * min(1.0, max(0.0, 2 * share - 0.5))


@dataclass
class Budget:
    """At most `total` environment steps and, where they are given, `minutes` of training; the first of the two ends it.

    `elapsed`: seconds of training so far, those before a resume included; not counted where there is no limit, so that
    nothing depends on a clock then. `again`: steps that are made a second time, and do not count twice.
    """

    total: int
    minutes: float | None = None
    elapsed: float = 0.0
    again: int = 0
    _read: float = field(default_factory=time.monotonic, repr=False)  # the clock when it was last read

    @property
    def seconds(self) -> float:
        """Seconds that the training may take."""
        return math.inf if self.minutes is None else 60 * self.minutes

    @property
    def end(self) -> int:
        """The step with which the training ends, unless time does."""
        return self.total + self.again

    def start(self) -> None:
        """Begin to count, or go on after a resume: what lies before is not counted."""
        self._read = time.monotonic()

    def tick(self) -> None:
        """Read the clock, once for each pass of the loop: all that asks in between gets the same answer."""
        if self.minutes is not None:
            now = time.monotonic()
            self.elapsed, self._read = self.elapsed + now - self._read, now

    def share(self, step: int) -> float:
        """Share of the budget that is used after `step` steps, by the limit that is nearer."""
        return max((step - self.again) / self.total, self.elapsed / self.seconds)

    def reached(self, step: int, share: float = 1.0) -> bool:
        """Tell whether a share of the budget is used; all of it where none is named."""
        return step - self.again >= self.total * share or self.elapsed >= self.seconds * share

    def expected_steps(self, step: int) -> int:
        """Steps that the training will have made at its end, if it goes on as fast as until `step` (at least 1)."""
        share = self.share(step)
        by_steps = share <= (step - self.again) / self.total
        return self.end if by_steps else max(step, round(step / share))

    def begin_second_half(self, step: int) -> None:
        """From now on half of the budget counts as used, unless more is: as many steps are left as were made."""
        self.total = min(self.total, 2 * (step - self.again))

    def go_back(self, step: int, share: float) -> None:
        """From now on only this share of the steps counts as made."""
        self.again = max(0, step - round(self.total * share))

    def summary(self, step: int) -> str:
        """What of both limits is used after `step` steps, in one line."""
        return f"{self.elapsed / 60:.1f} of {self.minutes:g} minutes used, {step:,} of at most {self.end:,} steps"

    def state(self) -> dict[str, Any]:
        """Everything that `restore` needs."""
        return {"elapsed": self.elapsed, "total": self.total, "again": self.again}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.elapsed, self.total = float(state["elapsed"]), int(state["total"])
        self.again = int(state["again"])
