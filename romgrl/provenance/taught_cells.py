"""Which cells of a library teach a student that follows commands: a rule that is in the keys of what is taught."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from romgrl.config.commanded import USUAL_STIFFNESS, ConditionedStudent
from romgrl.config.values import refusal

if TYPE_CHECKING:
    import pandas as pd

MULTIPLE_SLACK = 1e-6
"""Of a speed, in steps, by which it may miss a multiple; of a share of stiffness, and of a distance in m/s."""
ANOTHER_GAIT = 10.0
"""m/s that a cell of another gait counts as far, which is the most that can be asked for."""


def can_teach(table: pd.DataFrame) -> pd.Series:
    """Which rows of library.csv: fit ones on legs of the usual stiffness, and no jumps."""
    usual = (table.stiffness_share - USUAL_STIFFNESS).abs() < MULTIPLE_SLACK
    return table.fit.astype(bool) & usual & (table.apex_m == 0)


def too_far(student: ConditionedStudent, taught: Sequence[tuple[str, float]]) -> str:
    """What to say where a cell, gait and speed in m/s, has none of the taught ones at student.mismatch_distance; else
    an empty text."""
    reach = min(max(ANOTHER_GAIT if a != b else abs(v - w) for b, w in taught) for a, v in taught)
    if not student.mismatched_share or reach >= student.mismatch_distance - MULTIPLE_SLACK:
        return ""
    permitted = f"at most {reach:g} m/s, how far each cell of the library has another; or mismatched_share 0"
    return refusal("student.mismatch_distance", student.mismatch_distance, permitted)


def is_taught(speed: float, step: float | None) -> bool:
    """Tell whether a speed is a multiple of `student.taught_step`, m/s."""
    return step is None or abs(speed / step - round(speed / step)) <= MULTIPLE_SLACK
