"""The words that YAML may use in `${...}` beside OmegaConf's and Hydra's own: `draw` (search_space.py) and `within`."""

from __future__ import annotations

from typing import Any

from omegaconf import OmegaConf

from romgrl.cli.search_space import random_value


def register() -> None:
    """Tell OmegaConf the words."""
    OmegaConf.register_new_resolver("draw", random_value, replace=True)
    OmegaConf.register_new_resolver("within", within, replace=True)


def within(value: Any, limits: Any, otherwise: float) -> Any:
    """The value where it lies between two limits; something else where it does not, or where there are no such limits.

    `${within:${speed},${.speeds},1.25}`: the speed that is asked for, if it is one of this teacher's.
    """
    try:
        low, high = limits
        return value if low <= value <= high else otherwise
    except (TypeError, ValueError):  # no limits, or wrong ones, which are told of by their own key
        return otherwise
