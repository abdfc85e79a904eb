"""Students of one speed beside which one of every speed is put, and what is scored of its episodes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from romgrl.config.commanded import EPISODE_SECONDS, GRID_STAGES, is_conditioned
from romgrl.config.schema import Config
from romgrl.config.values import refusal
from romgrl.errors import RomgrlError

SPECIALISTS_KEY = "evaluation.specialists"
SPECIALISTS_KEYS = (SPECIALISTS_KEY, "student.kind", "stage")
GRID_WINDOW_KEYS = ("evaluation.window", "student.kind", "stage", "humanoid.control_frequency")


def specialists(config: Config) -> Iterator[str]:
    """Specialists are finished evaluations of students of one speed, beside one that follows commands."""
    places = config.evaluation.specialists
    if places is None:
        return
    if not is_conditioned(config):
        yield refusal(
            SPECIALISTS_KEY,
            places,
            f"null with student.kind={config.student.kind}: they stand beside one of every speed",
        )
    elif config.stage in GRID_STAGES:
        from romgrl.report.specialists import read_specialist

        for place in places:
            try:
                read_specialist(Path(place))
            except (RomgrlError, OSError) as error:
                reason = error.strerror if isinstance(error, OSError) else error
                yield refusal(SPECIALISTS_KEY, place, f"finished evaluations of students of one speed ({reason})")
                return


def window_of_a_cell(config: Config) -> Iterator[str]:
    """What is scored at a cell fits into its episodes."""
    steps = round(EPISODE_SECONDS * config.humanoid.control_frequency)
    if is_conditioned(config) and config.stage in GRID_STAGES and config.evaluation.window > steps:
        permitted = f"at most {steps}, the steps of {EPISODE_SECONDS:g} s, with student.kind={config.student.kind}"
        yield refusal("evaluation.window", config.evaluation.window, permitted)


GRID_CHECKS = ((SPECIALISTS_KEYS, specialists), (GRID_WINDOW_KEYS, window_of_a_cell))
