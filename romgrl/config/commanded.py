"""Keys of a student that follows commands, beside those of every student."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from romgrl.config.fields import key
from romgrl.config.learners import Student

if TYPE_CHECKING:
    from romgrl.config.schema import Config

CONDITIONED = "conditioned"
USUAL_STIFFNESS = 1.0
"""Share of a leg's stiffness at which a cell of a library is taught."""
GRID_STAGES = ("evaluation", "report", "all")
"""Values of `stage` that evaluate a student over the grid of commands, or need that."""


@dataclass
class ConditionedStudent(Student):
    """One student for every speed and gait of a library; the baseline is asked for the same, without imitation."""

    hold_seconds: list[float] = key(
        "a command is held for so long, drawn anew each time", unit="s", above=0, high=1000, span=True
    )
    step_share: float = key(
        "share of later commands with a speed from anywhere in the range; the others are within 1 m/s of the one "
        "before",
        low=0,
        high=1,
    )
    standing_share: float = key("share of commands to stand, paid for the speed alone", low=0, high=0.5)
    relabelled_share: float = key(
        "share of the transitions of a batch whose command is exchanged for another one when they are drawn, half of "
        "these near the speed that they had, half from all that is open",
        low=0,
        high=1,
    )
    mismatched_share: float = key(
        "share of the discriminator's fakes that are windows of the reference beside a command that is not theirs",
        low=0,
        high=0.9,
    )
    mismatch_distance: float = key(
        "how far their speed is from the one of the command, at least; another gait counts as far",
        unit="m/s",
        above=0,
        high=10,
    )
    curriculum: bool = key(
        "true: the speeds of a gait open from the middle, 0.25 m/s at a time, as soon as those at the edge are solved, "
        "and all of them after half of the training; false: all are open"
    )
    stratify: bool = key("true: in a batch of the discriminator the student has as many windows of each gait")
    standardize_by_command: bool = key(
        "true: windows are standardised by mean and deviation of the reference at their command; false: by those of "
        "all references together"
    )
    final_eta: float | None = key(
        "eta moves to this over the middle half of a training, unless there is no imitation; null: it stays, or "
        "adapt_eta steers it",
        low=0,
        high=1,
        before=None,
    )
    taught_step: float | None = key(
        "references are taught at multiples of this speed alone; the others are never shown, only checked, though "
        "their speeds are asked for; null: all that are fit are taught",
        unit="m/s",
        low=1e-6,
        high=10,
    )


STUDENTS: dict[str, type[Student]] = {"one_speed": Student, CONDITIONED: ConditionedStudent}
"""The keys of each kind of student."""


def is_conditioned(config: Config) -> bool:
    """Tell whether the student of a configuration follows commands."""
    return config.student.kind == CONDITIONED


def conditioned_keys(student: Student) -> ConditionedStudent:
    """The keys of a student that follows commands, as those that are asked for them do."""
    assert isinstance(student, ConditionedStudent)
    return student


READ_LIBRARY = ("student", "baseline", *GRID_STAGES, "export", "watch")
"""The values of `stage` that read a library where the student is conditioned."""


def needs_library(config: Config) -> bool:
    """Tell whether the stage that is asked for is a library, or reads one that is not taken from the package."""
    reads = is_conditioned(config) and config.stage in READ_LIBRARY and not config.student.pretrained
    return config.stage == "library" or reads
