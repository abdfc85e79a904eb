"""What a reduced-order model can be, as far as a configuration says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from romgrl.config.schema import Config
from romgrl.config.values import schema_keys

ROM_KEYS = tuple(key for key in schema_keys() if key.startswith(("rom.", "humanoid.")))


def reduced_order_model(config: Config) -> Iterator[str]:
    """The reduced-order model can be: it says which of its parameters is at fault."""
    from romgrl.rom.registry import refused_parameters

    yield from refused_parameters(config.rom.model, composed_parameters(config), config.humanoid.control_frequency)


def composed_parameters(config: Config) -> Any:
    """The parameters of the model before the humanoid is built.

    MuJoCo, which knows the humanoid's sizes, is not imported: where they are taken from it, the model's own stand here,
    and the stages, which know them, ask again.
    """
    from romgrl.rom.registry import parameters_of

    return parameters_of(config.rom, {"mass": config.humanoid.mass if config.humanoid.xml is None else None})
