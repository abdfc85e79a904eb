"""The project's own pieces, built from its configuration as a user's command line would."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from hydra import compose, initialize_config_dir

from romgrl import pipeline
from romgrl.algorithms.rom_grl import RomGrl
from romgrl.composition import CONF, register_schema, to_config
from romgrl.config import Config
from romgrl.gait.windows import FrameWindows
from romgrl.humanoid.observation import OBSERVATION_SIZE
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.progress import SilentLog
from romgrl.stages import student
from romgrl.stages.walkers import humanoid_env

PLAIN_SAC = (
    "student=sac",
    "discriminator=none",
    "eta=1",
    "student.policy_delay=1",
    "student.num_envs=32",
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
    pipeline.prepare(config)
    return config


@dataclass
class Student:
    """A student's pieces with a replay buffer that random actions have filled up to `learning_starts`."""

    config: Config
    env: PlanarHumanoidVectorEnv
    columns: torch.Tensor
    windows: FrameWindows
    learner: RomGrl

    def updates(self, count: int) -> Callable[[], object]:
        """`count` updates, drawn and done as in the stage, at most 30 in one call."""
        return lambda: [self.learner.update(min(30, count - done)) for done in range(0, count, 30)]


def filled_student(*overrides: str, threads: int) -> Student:
    """Build learner and environments and let the stage itself fill the buffer."""
    config = configuration(*overrides, threads=threads)
    env = humanoid_env(config, num_envs=config.student.num_envs)
    size = env.compact_columns if config.student.compact_observation else range(OBSERVATION_SIZE)
    columns = torch.as_tensor(list(size))
    trunk = config.discriminator.features == "trunk"
    windows = FrameWindows(num_envs=env.num_envs, columns=6 if trunk else 5, window=config.discriminator.window)
    learner = student.build_learner(config, env, columns, windows, None)
    student.train(config, env, columns, windows, learner, SilentLog(), save=lambda: None)
    return Student(config, env, columns, windows, learner)
