"""The reduced-order model of a configuration: its parameters, its vector environment."""

from __future__ import annotations

from typing import Any

from romgrl.config.schema import Config
from romgrl.errors import ConfigurationError
from romgrl.humanoid import model
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.registry import MODELS, parameters_of, refused_parameters
from romgrl.stages.wiring.commands import asked, asked_in_training


def rom_env(config: Config, *, num_envs: int, episode_steps: int, training: bool = False) -> RomVectorEnv:
    """The reduced-order model of the configuration, `num_envs` times.

    training: worlds are asked for what ranges over them while a teacher learns, not for what is asked of it later.
    """
    teacher = config.teacher
    cost = {"work_cost": teacher.work_cost} if teacher.work_cost else {}  # which not every model has
    return MODELS[config.rom.model].worlds(
        parameters=rom_parameters(config),
        num_envs=num_envs,
        speed=asked_in_training(config) if training else asked(config),
        control_frequency=config.humanoid.control_frequency,
        episode_steps=episode_steps,
        reward=teacher.reward,
        alpha=teacher.alpha,
        num_threads=config.threads,
        **cost,
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


def drawn_feet(config: Config) -> dict[str, float]:
    """What the player draws of the model's feet, m: foot_radius and, 0 where they do not roll, roll_over_radius."""
    parameters = rom_parameters(config)
    return {
        "foot_radius": float(parameters.foot_radius),
        "roll_over_radius": float(getattr(parameters, "roll_over_radius", 0.0)),
    }
