"""Every reduced-order model that `rom.model` can name; romgrl.config.worlds has the keys of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from romgrl.config.values import refusal
from romgrl.rom import drawing, parameters
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.vector_env import SpringLegVectorEnv, VariableLegVectorEnv


@dataclass(frozen=True)
class ReducedOrderModel:
    """One kind of reduced-order model.

    parameters: their dataclass, named as the keys of `rom`. worlds: makes the vector environment of `parameters`,
    num_envs, speed, control_frequency, episode_steps, reward, alpha and num_threads. commands: they take `Commands` for
    the speed, too, and work_cost. faults: yields the name of each of the parameters
    that cannot be at a control frequency, Hz, and what could. draw: picture (360, 640, 3) of features (5,),
    contact (2,), place x in m and parameters, in which the ground lies `ground` of the height below the top.
    """

    parameters: Callable[..., Any]
    worlds: Callable[..., RomVectorEnv]
    faults: Callable[[Any, float], Iterator[tuple[str, str]]]
    draw: Callable[..., Any]
    ground: float = drawing.GROUND
    commands: bool = False


MODELS: dict[str, ReducedOrderModel] = {
    "spring_leg": ReducedOrderModel(
        parameters.SpringLegParameters, SpringLegVectorEnv, parameters.unfit_parameters, drawing.draw, commands=True
    ),
    "variable_leg": ReducedOrderModel(
        parameters.VariableLegParameters, VariableLegVectorEnv, parameters.unfit_parameters, drawing.draw, commands=True
    ),
}


def parameters_of(rom: Any, sizes: Mapping[str, float | None]) -> Any:
    """Parameters of the model that the group `rom` of a configuration chooses.

    sizes: of the humanoid, for what is null there: mass, kg, leg_length and foot_radius, m. Those that it lacks, or
    that are None, stand at the model's own.
    """
    values = {name: value for name, value in vars(rom).items() if name not in ("name", "model")}
    values |= {name: size for name, size in sizes.items() if values[name] is None}
    shared = ("mass", "leg_length", "foot_radius")
    return MODELS[rom.model].parameters(
        **{name: value for name, value in values.items() if value is not None or name not in shared}
    )


def refused_parameters(model: str, parameters: Any, control_frequency: float) -> Iterator[str]:
    """Yield the line of each parameter of a model that cannot be at a control frequency, Hz."""
    for name, permitted in MODELS[model].faults(parameters, control_frequency):
        yield refusal(f"rom.{name}", getattr(parameters, name, None), permitted)
