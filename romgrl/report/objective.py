"""The one number that a search of settings is after: its name, and its value in the results of a job."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from pathlib import Path

from romgrl.gait.features import ALIGNMENTS, ALL, CHANNELS
from romgrl.gait.measures import MEASURES
from romgrl.gait.null_models import AVERAGE, MEAN_ERROR, OVER_VARIANCE, REDUCTIONS, SCORED
from romgrl.report.grid_tables import evaluation_metrics, grid_names
from romgrl.report.terminal_tables import with_falls, with_weakest

MOST_FALLS = 50.0  # percent of the episodes; a walker that falls more often has no error and no distance either
ONE_SPEED = "one_speed"  # a kind of student, `student.kind`
OF_FALLS = ("falls", "falls_percent")
SEARCHED = ("all", "evaluation", "teacher")  # values of `stage` whose jobs have numbers, whatever they reuse


def objective_names(stage: str, kind: str = ONE_SPEED) -> list[str]:
    """The names of the numbers that jobs of a value of `stage` can have, with a kind of student; none for those that
    have none."""
    if kind != ONE_SPEED and stage in ("all", "evaluation"):
        return grid_names()
    if stage == "teacher":
        return [f"teacher/{measure}" for measure in MEASURES]
    if stage not in SEARCHED:
        return []
    from romgrl.gait.distances import DISTANCES, FLOOR  # takes a second to import

    walkers = ("student", "baseline")
    names = [
        *product(("average", *CHANNELS), ALIGNMENTS, (*walkers, FLOOR, "reduction_percent")),
        ("weakest", "aligned", "reduction_percent"),
        *product(DISTANCES, [ALL], (FLOOR, *SCORED)),
        *product(["mmd"], [ALL], ("student_p", "baseline_p", "floor_p")),
        *product(REDUCTIONS.values(), (AVERAGE, MEAN_ERROR), SCORED),
        *product([OVER_VARIANCE], [AVERAGE], SCORED),
        *product(("teacher", *walkers), MEASURES),
    ]
    return ["/".join(name) for name in names]


def objective_of(name: str, artifacts: Mapping[str, Path]) -> float:
    """The number of that name in the artifacts of a job's stages.

    nan where there is none, as for the error of a student that falls, and for the gait of a walker that falls in most
    of its episodes.
    """
    stage = next((stage for stage in ("evaluation", "teacher") if stage in artifacts), None)
    if stage is None:
        return math.nan
    numbers = with_weakest(with_falls(evaluation_metrics(artifacts[stage])))
    walker, _, measure = name.partition("/")
    if numbers.get(f"{walker}/falls_percent", 0.0) > MOST_FALLS and measure not in OF_FALLS:
        return math.nan
    return numbers.get(name, math.nan)
