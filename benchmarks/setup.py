"""The project's own pieces, built from its configuration as a user's command line would."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np
from hydra import compose, initialize_config_dir

from romgrl.algorithms.rom_grl import RomGrl
from romgrl.artifacts import save_arrays
from romgrl.cli.compose import register_schema, to_config
from romgrl.cli.config_files import CONF
from romgrl.config.schema import Config
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.pipeline import run as pipeline
from romgrl.pipeline import worker
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student

T = TypeVar("T")

PLAIN_SAC = (
    "student=sac",
    "discriminator=none",
    "eta=1",
    "student.policy_delay=1",
    "student.policy_updates=1",
    "student.num_envs=32",
    "student.updates_per_step=0.1875",
    "student.learning_starts=10_000",
    "student.total_steps=10_000",
    "student.buffer_size=16_000",
)
"""SAC without anything of ours: minimum of two critics, a policy update in every update, all 358 columns."""


def configuration(*overrides: str, threads: int) -> Config:
    """What `python -m romgrl` with these overrides would run; torch is set up as before a stage."""
    register_schema()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = pipeline.resolve(to_config(compose("config", [*overrides, f"threads={threads}"])))
    worker.prepare(config)
    return config


@dataclass
class Student:
    """What the student stage has made when its training begins, and that training itself."""

    config: Config
    env: PlanarHumanoidVectorEnv
    learner: RomGrl
    _train: Callable[[Config], None]

    def train(self, **changes: Any) -> None:
        """The stage's own loop, with changed keys of `student`."""
        self._train(replace(self.config, student=replace(self.config.student, **changes)))

    def fill(self) -> None:
        """Random actions until the replay buffer has what learning starts with."""
        self.train(total_steps=self.config.student.learning_starts)

    def updates(self, count: int) -> Callable[[], object]:
        """`count` updates as the stage draws and does them: those of one step of all humanoids in a call, then those of
        the discriminator that are due."""
        student = self.config.student
        at_once = max(1, round(student.updates_per_step * student.num_envs))

        def work() -> None:
            for done in range(0, count, at_once):
                self.learner.update(min(at_once, count - done))
                self.learner.start_discriminator()()

        return work


def in_student_stage(measure: Callable[[Student], T], config: Config, reference: Path | None = None) -> T:
    """Run the student stage with `measure` in the place of its training, so that threads are laid out as in it."""
    found: list[T] = []
    train = student.train_student

    def instead(config: Config, training: student.StudentTraining, *rest: Any) -> None:
        env, learner = training.env, training.learner
        found.append(measure(Student(config, env, learner, lambda changed: train(changed, training, *rest))))

    with tempfile.TemporaryDirectory() as directory, patch.object(student, "train_student", instead):
        student.run(config, {"reference": reference} if reference else {}, Path(directory), SilentLog())
    return found[0]


def write_reference(directory: Path) -> Path:
    """A reference of feet that swing in antiphase: what it holds does not change how long a training step takes."""
    phase = 2 * np.pi * 1.7 * np.arange(2000) / 30
    left, right = np.sin(phase), np.sin(phase + np.pi)
    columns = (0.9 + 0.04 * np.cos(2 * phase), 0.4 * left, -0.85 + 0.05 * left, 0.4 * right, -0.85 + 0.05 * right)
    features = np.stack(columns, axis=-1).astype(np.float32)
    arrays: dict[str, Any] = {"features": features, "episode": np.zeros(2000, np.int32), "dt": 1 / 30, "speed": 4.0}
    save_arrays(directory / "reference.npz", arrays)
    return directory
