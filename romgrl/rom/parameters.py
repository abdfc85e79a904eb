"""Parameters of the spring-leg model, in SI units, and their translation for the C++ core."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

from romgrl.errors import ConfigurationError
from romgrl.rom import _core

Reward = Literal["exponential", "forward_velocity"]
Observation = Literal["full", "paper"]
Engine = Literal["box2d", "native"]

_RANGES = ("reset_hip_angle", "reset_speed", "reset_drop")


def _default(name: str) -> Any:
    if name not in _core.PARAMETERS:
        raise ConfigurationError(f"rom.{name}: the C++ core was built without it; build it again with `make install`")
    return _core.PARAMETERS[name][0]


@dataclass(frozen=True)
class SpringLegParameters:
    """A trunk on two spring legs; the keys mean what they mean in the configuration group `rom`.

    The defaults, those of cpp/rom/parameters.hpp, are a human-sized model that runs at 4 m/s. Values are checked when
    worlds are built: the constructors of the environments raise ValueError for a value that is not finite, out of
    range, or unstable.
    """

    mass: float = _default("mass")
    leg_length: float = _default("leg_length")
    foot_radius: float = _default("foot_radius")
    roll_over_radius: float = _default("roll_over_radius")
    foot_mass: float = _default("foot_mass")
    stiffness: float = _default("stiffness")
    stance_damping: float = _default("stance_damping")
    swing_damping: float = _default("swing_damping")
    hip_torque: float = _default("hip_torque")
    torque_lag: float = _default("torque_lag")
    trunk_moment_limit: float | None = _default("trunk_moment_limit")
    retraction: float = _default("retraction")
    retraction_time: float = _default("retraction_time")
    hip_angle_limit: float = _default("hip_angle_limit")
    compression_limit: float = _default("compression_limit")
    extension_limit: float = _default("extension_limit")
    friction: float = _default("friction")
    trunk_locked: bool = _default("trunk_locked")
    trunk_inertia: float = _default("trunk_inertia")
    trunk_pitch_limit: float = _default("trunk_pitch_limit")
    fall_height: float = _default("fall_height")
    substeps: int = _default("substeps")
    velocity_iterations: int = _default("velocity_iterations")
    position_iterations: int = _default("position_iterations")
    reset_hip_angle: tuple[float, float] = (0.33, 0.42)
    reset_speed: tuple[float, float] = (0.9, 1.05)
    observation: Observation = "full"
    engine: Engine = "box2d"


@dataclass(frozen=True)
class VariableLegParameters(SpringLegParameters):
    """The same with a motor in series with the spring of each leg, which moves the end of its rest length.

    See cpp/rom/leg_motor.hpp for the equations, and the configuration group `rom` for the keys.
    """

    engine: Engine = "native"
    foot_mass: float = 0.82
    retraction: float = 0.0  # the motors lift the feet
    extension_limit: float = 1.15  # above longest_rest: a leg that pushes ends on its spring, not on a stop
    motor_force: float = _default("motor_force")
    motor_speed: float = _default("motor_speed")
    motor_power: float = _default("motor_power")
    motor_eccentric: float = _default("motor_eccentric")
    motor_eccentric_speed: float = _default("motor_eccentric_speed")
    motor_mass: float = _default("motor_mass")
    motor_damping: float = _default("motor_damping")
    motor_lag: float = _default("motor_lag")
    shortest_rest: float = _default("shortest_rest")
    longest_rest: float = _default("longest_rest")
    reset_together: bool = _default("reset_together")
    reset_by_speed: bool = _default("reset_by_speed")
    reset_drop: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Commands:
    """What is asked of each world: drawn for each episode, and anew after every `hold_steps` control steps.

    speed: range of the speed to be held, m/s; stiffness_share: range of the stiffness of both legs, share of the
    parameter; hold_steps: 0 for one command an episode; apex: range of the rise of a jump over a body that stands, m,
    which legs with motors are told.
    """

    speed: tuple[float, float] = (4.0, 4.0)
    stiffness_share: tuple[float, float] = (1.0, 1.0)
    hold_steps: int = 0
    apex: tuple[float, float] = (0.0, 0.0)


def standing_height(parameters: SpringLegParameters) -> float:
    """Height of the trunk on legs of their rest length, m, which the apex of a jump is measured from."""
    return parameters.leg_length + parameters.foot_radius


def core_parameters(
    parameters: SpringLegParameters,
    *,
    speed: float | Commands,
    control_frequency: float,
    episode_steps: int,
    reward: Reward,
    alpha: float,
    work_cost: float = 0.0,
) -> _core.Parameters:
    """The C++ core's parameters of one task. Raises ValueError for a value of the wrong type or choice.

    speed: one for all worlds, m/s, or commands; work_cost: of the positive power of all actuators, per body weight
    and sqrt(g L0).
    """
    if not isinstance(parameters, SpringLegParameters):
        raise ValueError(f"parameters {parameters!r} are no SpringLegParameters")
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
        values |= span(name, getattr(parameters, name)) if hasattr(parameters, name) else {}
    if parameters.trunk_moment_limit is None:
        values["trunk_moment_limit"] = math.inf
    commands = speed if isinstance(speed, Commands) else Commands((speed_of_all(speed),) * 2)
    for name in ("speed", "stiffness_share", "apex"):
        values |= span(name, getattr(commands, name))
    values |= {"command_steps": commands.hold_steps, "work_cost": work_cost}
    values |= {"leg_motor": isinstance(parameters, VariableLegParameters)}
    values |= {"control_frequency": control_frequency, "episode_steps": episode_steps, "alpha": alpha}
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


def speed_of_all(speed: float) -> float:
    """A speed for all worlds, m/s. Raises ValueError, with the name that a caller knows it by, for one out of range."""
    _, low, high = _core.PARAMETERS["speed_low"]
    if isinstance(speed, (int, float)) and not low <= speed <= high:
        raise ValueError(f"speed = {speed:g} is not between {low:g} and {high:g}")
    return speed


def span(name: str, values: Any) -> dict[str, object]:
    """The core's two numbers of a range. Raises ValueError unless there are two."""
    try:
        low, high = values
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} = {values!r} must be two numbers, low and high") from error
    return {f"{name}_low": low, f"{name}_high": high}


def unfit_parameters(parameters: SpringLegParameters, control_frequency: float) -> Iterator[tuple[str, str]]:
    """Yield the name of each parameter that cannot be, and what could: the core says what it can integrate."""
    if max(parameters.reset_hip_angle) > parameters.hip_angle_limit:
        yield "reset_hip_angle", f"at most rom.hip_angle_limit = {parameters.hip_angle_limit:g} rad"
    standing = replace(parameters, reset_hip_angle=(0.0, 0.0), reset_speed=(1.0, 1.0))
    task: dict[str, Any] = {"speed": 1.0, "episode_steps": 1, "reward": "exponential", "alpha": 1.0}
    try:
        _core.Batch(core_parameters(standing, control_frequency=control_frequency, **task), 1, 1)
    except ValueError as error:
        yield str(error).partition(" ")[0].rstrip(":"), f"what can be integrated: {error}"
