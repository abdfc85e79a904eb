"""The walkers of a configuration: reduced-order model and humanoid, as models and vector environments."""

from __future__ import annotations

from typing import Any, cast

from romgrl.config.schema import Config
from romgrl.humanoid import model
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.rom.parameters import Reward, SpringLegParameters
from romgrl.rom.vector_env import SpringLegVectorEnv


def rom_env(config: Config, *, num_envs: int, episode_steps: int) -> SpringLegVectorEnv:
    """The reduced-order model of the configuration, `num_envs` times."""
    return SpringLegVectorEnv(
        parameters=rom_parameters(config),
        num_envs=num_envs,
        speed=config.teacher.speed,
        control_frequency=config.humanoid.control_frequency,
        episode_steps=episode_steps,
        reward=cast(Reward, config.teacher.reward),
        alpha=config.teacher.alpha,
        num_threads=config.threads,
    )


def rom_parameters(config: Config) -> SpringLegParameters:
    """Parameters of the reduced-order model; those that are null come from the humanoid."""
    sizes = model.dimensions(humanoid_model(config))
    values = {name: value for name, value in vars(config.rom).items() if name != "name"}
    defaults = {"mass": sizes.mass, "leg_length": sizes.leg_length, "foot_radius": sizes.ankle_height}
    values |= {name: value for name, value in defaults.items() if values[name] is None}
    return SpringLegParameters(**values)


def humanoid_model(config: Config) -> Any:
    """MuJoCo model of the humanoid of the configuration."""
    return model.configured(config.humanoid)


def humanoid_env(
    config: Config, *, num_envs: int, episode_steps: int | None = None, compact: bool = False, body: Any = None
) -> PlanarHumanoidVectorEnv:
    """The humanoid of the configuration, `num_envs` times; episode_steps: None for the configuration's.

    `compact`: observations without the columns that are constant in the plane; `body`: another model in its place.
    """
    humanoid = config.humanoid
    return PlanarHumanoidVectorEnv(
        model=humanoid_model(config) if body is None else body,
        num_envs=num_envs,
        compact=compact,
        speed=config.speed,
        alpha=config.student.alpha,
        episode_steps=episode_steps or humanoid.episode_steps,
        reset_speed=tuple(humanoid.reset_speed),
        fall_pelvis_height=humanoid.fall_pelvis_height,
        fall_head_height=humanoid.fall_head_height,
        fall_trunk_lean=humanoid.fall_trunk_lean,
        control_frequency=humanoid.control_frequency,
        num_threads=config.threads,
    )
