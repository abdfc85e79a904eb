"""What is joined with a library: finished libraries like it, and no cell twice."""

from __future__ import annotations

from collections.abc import Iterator
from os.path import isabs
from pathlib import Path

from romgrl.cli.teacher_ranges import RANGES
from romgrl.config.commanded import needs_library
from romgrl.config.schema import Config
from romgrl.config.values import refusal, schema_keys
from romgrl.errors import RomgrlError

OTHERS_KEY = "library.others"
OTHER_LIBRARIES_KEYS = (
    "stage",
    "student.kind",
    "reference.steps",
    "humanoid.control_frequency",
    *(key for key in schema_keys() if key.startswith("library.")),
    "teacher.gait",
    *RANGES,
    *RANGES.values(),
)


def other_libraries(config: Config) -> Iterator[str]:
    """The others are finished, whole, of the same steps, and have cells of their own."""
    if config.library.others is None or not needs_library(config):
        return
    from romgrl.provenance.library_grid import library_cells
    from romgrl.report.finished_library import asked_cell, cells_of, read_library

    steps, rate = config.reference.steps, config.humanoid.control_frequency
    asked = [at.teacher for at in library_cells(config)]
    known = {asked_cell(at.gait, at.speed, at.apex, at.stiffness_share) for at in asked}
    for place in config.library.others:
        if not isabs(place):  # as every text is by now
            permitted = f"finished libraries; a path that is a number stands in quotes: {OTHERS_KEY}=['{place}']"
            yield refusal(OTHERS_KEY, place, permitted)
            return
        try:
            cells = [*cells_of(read_library(Path(place), steps=steps, dt=1.0 / rate).table)]
        except (RomgrlError, OSError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            yield refusal(OTHERS_KEY, place, f"finished libraries of {steps} steps at {rate:g} Hz ({reason})")
            return
        for cell in cells:
            if cell in known:
                again = f"{Path(place).name} has again: {cell}"
                yield refusal(OTHERS_KEY, place, f"libraries whose cells are in no other ({again})")
                return
        known |= set(cells)
