"""Parameters of the spring-leg model, in SI units, and their translation for the C++ core."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal, get_args

from romgrl.rom import _core

Reward = Literal["exponential", "forward_velocity"]
Observation = Literal["full", "paper"]
Engine = Literal["box2d", "native"]

_RANGES = ("reset_hip_angle", "reset_speed")


@dataclass(frozen=True)
class SpringLegParameters:
    """A trunk on two spring legs; the keys mean what they mean in the configuration group `rom`.

    The defaults are the human-sized model that runs at 4 m/s. Values are checked when worlds are built: the
    constructors of the environments raise ValueError for a value that is not finite, out of range, or unstable.
    """

    mass: float = 71.8
    leg_length: float = 0.865
    foot_radius: float = 0.072
    foot_mass: float = 0.7
    stiffness: float = 24000.0
    stance_damping: float = 30.0
    swing_damping: float = 140.0
    hip_torque: float = 60.0
    torque_lag: float = 0.02
    trunk_moment_limit: float | None = 25.0
    retraction: float = 0.15
    retraction_time: float = 0.08
    hip_angle_limit: float = 1.3
    compression_limit: float = 0.5
    extension_limit: float = 1.05
    friction: float = 1.0
    trunk_locked: bool = True
    trunk_inertia: float = 3.0
    trunk_pitch_limit: float = 1.0
    fall_height: float = 0.6
    substeps: int = 16
    velocity_iterations: int = 8
    position_iterations: int = 3
    reset_hip_angle: tuple[float, float] = (0.33, 0.42)
    reset_speed: tuple[float, float] = (0.9, 1.05)
    observation: Observation = "full"
    engine: Engine = "box2d"


def core_parameters(
    parameters: SpringLegParameters,
    *,
    speed: float,
    control_frequency: float,
    episode_steps: int,
    reward: Reward,
    alpha: float,
) -> _core.Parameters:
    """The C++ core's parameters of one task. Raises ValueError for a value of the wrong type or choice."""
    if reward not in get_args(Reward):
        raise ValueError(f"reward {reward!r} is none of {get_args(Reward)}")
    if parameters.observation not in get_args(Observation):
        raise ValueError(f"observation {parameters.observation!r} is none of {get_args(Observation)}")
    if parameters.engine not in get_args(Engine):
        raise ValueError(f"engine {parameters.engine!r} is none of {get_args(Engine)}")
    values: dict[str, object] = {
        field.name: getattr(parameters, field.name)
        for field in fields(parameters)
        if field.name not in ("observation", "engine", *_RANGES)
    }
    for name in _RANGES:
        low, high = getattr(parameters, name)
        values |= {f"{name}_low": low, f"{name}_high": high}
    if parameters.trunk_moment_limit is None:
        values["trunk_moment_limit"] = math.inf
    values |= {"speed": speed, "control_frequency": control_frequency, "episode_steps": episode_steps, "alpha": alpha}
    values |= {"reward_is_velocity": reward == "forward_velocity"}
    values |= {"observation_is_paper": parameters.observation == "paper"}
    values |= {"engine_is_native": parameters.engine == "native"}
    core = _core.Parameters()
    for name, value in values.items():
        try:
            setattr(core, name, value)
        except TypeError as error:
            raise ValueError(f"{name} = {value!r} has the wrong type") from error
    return core
