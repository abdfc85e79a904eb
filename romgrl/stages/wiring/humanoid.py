"""The humanoid of a configuration: its model, its vector environment."""

from __future__ import annotations

from typing import Any

from romgrl.config.schema import Config
from romgrl.humanoid import model
from romgrl.humanoid.command_schedules import CommandSchedule
from romgrl.humanoid.task import sensitivity
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv


def humanoid_env(
    config: Config,
    *,
    num_envs: int,
    episode_steps: int | None = None,
    posture_weight: float = 0.0,
    compact: bool = False,
    body: Any = None,
    commands: CommandSchedule | None = None,
) -> PlanarHumanoidVectorEnv:
    """The humanoid of the configuration, `num_envs` times; episode_steps: None for the configuration's.

    `posture_weight`: share of the reward that is for the posture; `compact`: observations without the columns that are
    constant in the plane; `body`: another model in its place; `commands`: what it is asked for, None: the speed.
    """
    humanoid = config.humanoid
    return PlanarHumanoidVectorEnv(
        model=model.configured(config.humanoid) if body is None else body,
        num_envs=num_envs,
        compact=compact,
        speed=config.speed,
        alpha=config.student.alpha,
        posture_weight=posture_weight,
        episode_steps=episode_steps or humanoid.episode_steps,
        reset_speed=tuple(humanoid.reset_speed),
        fall_pelvis_height=humanoid.fall_pelvis_height,
        fall_head_height=humanoid.fall_head_height,
        fall_trunk_lean=humanoid.fall_trunk_lean,
        control_frequency=humanoid.control_frequency,
        num_threads=config.threads,
        commands=commands,
    )


def speed_sensitivity(config: Config) -> float:
    """Alpha of the velocity reward, s/m; where it is not given, what 1 is at 4 m/s, by the inverse of the speed."""
    return float(sensitivity(config.student.alpha, config.speed))
