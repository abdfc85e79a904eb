"""Which cells of a library teach a student that follows commands: a rule that is in the keys of what is taught."""

from __future__ import annotations

from typing import TYPE_CHECKING

from romgrl.config.commanded import USUAL_STIFFNESS

if TYPE_CHECKING:
    import pandas as pd

MULTIPLE_SLACK = 1e-6
"""Of a speed, in steps, by which it may miss a multiple."""


def can_teach(table: pd.DataFrame) -> pd.Series:
    """Which rows of library.csv: fit ones on legs of the usual stiffness, and no jumps."""
    return table.fit.astype(bool) & (table.stiffness_share == USUAL_STIFFNESS) & (table.apex_m == 0)


def is_taught(speed: float, step: float | None) -> bool:
    """Tell whether a speed is a multiple of `student.taught_step`, m/s."""
    return step is None or abs(speed / step - round(speed / step)) <= MULTIPLE_SLACK
