"""A small library of runs and walks, and a conditioned student that trains on it in seconds."""

from __future__ import annotations

from pathlib import Path

from romgrl.config.schema import Config
from romgrl.report.finished_library import RECORDED
from tests.conftest import Composer
from tests.helpers.synthetic_library import STEPS, synthetic_library, write_library

CONDITIONED = (
    "threads=1",
    "student=conditioned",
    "stage=student",
    f"reference.steps={STEPS}",
    "reference.episodes=2",
    "student.hidden_sizes=[32,32]",
    "student.num_envs=8",
    "student.total_steps=1600",
    "student.learning_starts=400",
    "student.batch_size=32",
    "student.buffer_size=960",
    "student.updates_per_step=0.1",
    "student.check_steps=800",
    "student.hold_seconds=[0.1,0.4]",
    "discriminator.batch_size=32",
    "discriminator.hidden_sizes=[32,16]",
    "discriminator.recent_steps=400",
    "evaluation.window=100",
    "humanoid.episode_steps=40",
)


def commanded(compose: Composer, *overrides: str) -> Config:
    """A training of 1,600 steps."""
    return compose(*CONDITIONED, *overrides)


def small_library(directory: Path) -> Path:
    """Runs at 2, 3 and 4 m/s and walks at 1 and 2 m/s, one run of which fell, and runs of stiff legs."""
    table, arrays = synthetic_library((1.0, 2.0, 3.0, 4.0), (1.0, 1.4), gaits=("run", "walk"))
    speed, walks = table.speed_m_per_s, table.gait == "walk"
    rows = table.index[(walks & (speed <= 2.0)) | (~walks & (speed >= 2.0))]
    kept = {name: values[rows] if name in RECORDED else values for name, values in arrays.items()}
    return Path(write_library(directory, table.loc[rows].reset_index(drop=True), kept))
