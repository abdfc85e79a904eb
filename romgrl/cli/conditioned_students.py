"""What a student that follows commands does not go with: stages of one speed, and libraries that cannot teach it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from romgrl.cli.other_libraries import OTHER_LIBRARIES_KEYS
from romgrl.config.commanded import (
    GRID_STAGES,
    USUAL_STIFFNESS,
    conditioned_keys,
    is_conditioned,
    needs_library,
)
from romgrl.config.schema import Config
from romgrl.config.values import refusal, show, value_of
from romgrl.errors import ConfigurationError, RomgrlError
from romgrl.provenance.taught_cells import is_taught, too_far

FOLLOWED = ("teacher", "reference", "library", "student", "baseline", *GRID_STAGES, "export", "watch", "sync")
"""The values of `stage` that a conditioned student has."""
BEGINS = ("export", "watch")
"""Those of them that begin with `speed`."""
OF_ONE_SPEED = {
    "student.end_early": False,
    "student.second_try": False,
    "discriminator.imitated": "teacher",
    "discriminator.reward": "recomputed",
}
CONDITIONED_KEYS = (
    "student.kind",
    "stage",
    "discriminator.loss",
    "library.others",
    "student.pretrained",
    "student.adapt_eta",
    "student.final_eta",
    *OF_ONE_SPEED,
)
BEGUN_KEYS = ("speed", "teacher.gait", "student.standing_share")
TAUGHT_KEYS = (
    *OTHER_LIBRARIES_KEYS,
    "student.kind",
    "student.taught_step",
    "student.mismatched_share",
    "student.mismatch_distance",
    "discriminator.enabled",
    "eta",
    "student.pretrained",
)


def conditioned_student(config: Config) -> Iterator[str]:
    """A student that follows commands goes with what knows of commands."""
    if not is_conditioned(config):
        return
    where = f"with student.kind={config.student.kind}"
    if config.stage not in FOLLOWED:
        yield refusal("stage", config.stage, f"{', '.join(FOLLOWED)} {where}: it has no one speed")
    if config.student.adapt_eta and (final := conditioned_keys(config.student).final_eta) is not None:
        yield refusal("student.final_eta", final, "null with student.adapt_eta=true, which steers eta")
    if config.student.pretrained and config.library.others is not None:
        yield refusal("library.others", config.library.others, "null with student.pretrained=true: its library ships")
    for key, needed in OF_ONE_SPEED.items():
        if value_of(config, key) != needed:
            yield refusal(key, value_of(config, key), f"{show(needed)} {where}")
    if config.discriminator.loss == "wasserstein":
        yield refusal("discriminator.loss", "wasserstein", f"bce or least_squares {where}: each command has its level")


def taught_by_library(config: Config) -> Iterator[str]:
    """The library that a student is to be taught by has cells enough, before any of them is made."""
    if not is_conditioned(config) or not needs_library(config) or config.student.pretrained:
        return
    try:
        usual = usual_cells(config)
    except (RomgrlError, OSError):  # `other_libraries` says so
        return
    student = conditioned_keys(config.student)
    taught = [(gait, speed) for gait, speed in usual if is_taught(speed, student.taught_step)]
    if len(usual) < 2 and config.teacher.speeds is None:
        yield refusal("teacher.speeds", None, "a range, or library.others, with student.kind=conditioned")
    elif not usual:
        key = "teacher.stiffness_share" if config.teacher.stiffness_shares is None else "library.stiffness_shares"
        yield refusal(key, value_of(config, key), "1, or with 1 among them, with student.kind=conditioned")
    elif not taught:
        speeds = ", ".join(f"{speed:g}" for _, speed in usual)
        yield refusal("student.taught_step", student.taught_step, f"a step with multiples among {speeds} m/s")
    elif config.stage in ("student", "export", *GRID_STAGES) and config.discriminator.enabled and config.eta < 1:
        yield from filter(None, [too_far(student, taught)])


def speed_begun_with(config: Config) -> Iterator[str]:
    """What begins with `speed` has a gait for it."""
    if not is_conditioned(config) or config.stage not in BEGINS:
        return
    from romgrl.humanoid.command_limits import CommandLimits

    student = conditioned_keys(config.student)
    try:
        usual = usual_cells(config)
        taught = {gait for gait, speed in usual if is_taught(speed, student.taught_step)}
        if cells := [cell for cell in usual if cell[0] in taught]:
            why = "as the student was taught" if student.pretrained else "as its library is asked for at most"
            CommandLimits.of(cells, student.standing_share).begun(config.speed, config.teacher.gait, why)
    except ConfigurationError as error:
        yield str(error)
    except (RomgrlError, OSError):  # `other_libraries` says so, and what ships where it is asked for
        return


def usual_cells(config: Config) -> list[tuple[str, float]]:
    """Gaits and speeds, m/s, that a library has on legs of the usual stiffness, whether fit or not where they are not
    made yet. Raises ArtifactError for other libraries that are none."""
    from romgrl.provenance.library_grid import library_cells
    from romgrl.provenance.shipped import follows_shipped, shipped_directory
    from romgrl.report.finished_library import asked_cell, cells_of, read_library

    ships = follows_shipped(config)
    teachers = [] if ships else [at.teacher for at in library_cells(config)]
    cells = [asked_cell(at.gait, at.speed, at.apex, at.stiffness_share) for at in teachers]
    for place in [shipped_directory("library", conditioned=True)] if ships else config.library.others or ():
        library = read_library(Path(place), steps=config.reference.steps, dt=1.0 / config.humanoid.control_frequency)
        cells += cells_of(library.table[library.table.fit])
    return [(cell.gait, cell.speed) for cell in cells if cell.share == USUAL_STIFFNESS and not cell.apex]


CONDITIONED_CHECKS = (
    (CONDITIONED_KEYS, conditioned_student),
    (TAUGHT_KEYS, taught_by_library),
    ((*TAUGHT_KEYS, *BEGUN_KEYS), speed_begun_with),
)
