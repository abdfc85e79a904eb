"""Students of one speed beside which one of every speed is put, and what is scored of its episodes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from romgrl.cli.conditioned_students import TAUGHT_KEYS, usual_cells
from romgrl.config.commanded import GRID_STAGES, is_conditioned
from romgrl.config.schema import Config
from romgrl.config.values import refusal
from romgrl.errors import RomgrlError
from romgrl.provenance.grid_episodes import EPISODE_SECONDS

SPECIALISTS_KEY = "evaluation.specialists"
SPECIALISTS_KEYS = (SPECIALISTS_KEY, *TAUGHT_KEYS)
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
        try:
            cells: list[tuple[str, float]] | None = usual_cells(config)
        except (RomgrlError, OSError):  # `other_libraries` says so
            cells = None
        yield from islice(objections(places, cells), 1)


def objections(places: list[str], cells: list[tuple[str, float]] | None) -> Iterator[str]:
    """Why specialists cannot stand beside a student of the cells of a library, None where these are not known.

    Each has a cell for itself: of two at one the first would count for nothing, as would one at none.
    """
    from romgrl.report.specialists import SPEED_DIGITS, read_specialist

    taken: dict[tuple[str, float], str] = {}
    free = None if cells is None else {(gait, round(speed, SPEED_DIGITS)) for gait, speed in cells}
    for place in places:
        try:
            found = read_specialist(Path(place))
        except (RomgrlError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            yield refusal(SPECIALISTS_KEY, place, f"finished evaluations of students of one speed ({reason})")
            continue
        cell, name = (found.gait, round(found.speed, SPEED_DIGITS)), f"{found.gait} at {found.speed:g} m/s"
        if free is not None and cell not in free:
            yield refusal(SPECIALISTS_KEY, place, f"students at gaits and speeds of the library ({name} is none)")
        elif cell in taken:
            yield refusal(SPECIALISTS_KEY, place, f"one of each gait and speed ({name} is {taken[cell]}, too)")
        taken[cell] = place


def window_of_a_cell(config: Config) -> Iterator[str]:
    """What is scored at a cell fits into its episodes."""
    steps = round(EPISODE_SECONDS * config.humanoid.control_frequency)
    if is_conditioned(config) and config.stage in GRID_STAGES and config.evaluation.window > steps:
        permitted = f"at most {steps}, the steps of {EPISODE_SECONDS:g} s, with student.kind={config.student.kind}"
        yield refusal("evaluation.window", config.evaluation.window, permitted)


GRID_CHECKS = ((SPECIALISTS_KEYS, specialists), (GRID_WINDOW_KEYS, window_of_a_cell))
