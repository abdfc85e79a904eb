"""Finished evaluations of students of one speed, beside which one of every speed is put (`evaluation.specialists`)."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

from romgrl.artifacts import open_artifact
from romgrl.artifacts.payload import reading
from romgrl.errors import ArtifactError

SPECIALIST_COLUMNS = ("walker", "target_speed_m_per_s", "error_over_variance", "falls", "episodes")
SPEED_DIGITS = 6  # of its speed and that of its cell, which are multiples of steps


class Specialist(NamedTuple):
    """The student of an evaluation: its gait, speed, m/s, error over variance against its own reference, and falls."""

    gait: str
    speed: float
    error: float
    falls: int
    episodes: int


def read_specialist(directory: Path) -> Specialist:
    """That of a finished evaluation. Raises ArtifactError for what is none, damaged, or of a student of many speeds."""
    manifest = open_artifact(directory, stage="evaluation")
    path = directory / "gait.csv"
    if not path.is_file():
        raise ArtifactError(f"{directory}: an evaluation of no student of one speed")
    with reading(path):
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    row = next((row for row in rows if row.get("walker") == "student"), {})
    missing = [name for name in SPECIALIST_COLUMNS if name not in row]
    if missing:
        raise ArtifactError(f"{path}: no column {', '.join(missing)} of a student")
    try:
        speed, error, falls, episodes = (float(row[name] or math.nan) for name in SPECIALIST_COLUMNS[1:])
        return Specialist(str(manifest.config.get("teacher.gait", "run")), speed, error, int(falls), int(episodes))
    except ValueError as error_of_number:
        raise ArtifactError(f"{path}: not a number: {error_of_number}") from error_of_number
