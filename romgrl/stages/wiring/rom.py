"""The reduced-order model of a configuration: its parameters, its vector environment."""

from __future__ import annotations

from typing import Any

from romgrl.config.schema import Config
from romgrl.errors import ConfigurationError
from romgrl.humanoid import model
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.registry import MODELS, parameters_of, refused_parameters


def rom_env(config: Config, *, num_envs: int, episode_steps: int) -> RomVectorEnv:
    """The reduced-order model of the configuration, `num_envs` times."""
    return MODELS[config.rom.model].worlds(
        parameters=rom_parameters(config),
        num_envs=num_envs,
        speed=config.teacher.speed,
        control_frequency=config.humanoid.control_frequency,
        episode_steps=episode_steps,
        reward=config.teacher.reward,
        alpha=config.teacher.alpha,
        num_threads=config.threads,
    )


def rom_parameters(config: Config) -> Any:
    """Parameters of the reduced-order model; those that are null come from the humanoid. Raises ConfigurationError."""
    body = model.dimensions(model.configured(config.humanoid))
    sizes = {"mass": body.mass, "leg_length": body.leg_length, "foot_radius": body.ankle_height}
    parameters = parameters_of(config.rom, sizes)
    refused = [*refused_parameters(config.rom.model, parameters, config.humanoid.control_frequency)]
    if refused:
        raise ConfigurationError("\n".join(refused))
    return parameters
