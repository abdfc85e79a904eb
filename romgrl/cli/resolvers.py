"""The words of a YAML file's `${...}` beside OmegaConf's and Hydra's own: `draw` (search_space.py) and `nearest`."""

from __future__ import annotations

from typing import Any

from omegaconf import OmegaConf

from romgrl.cli.search_space import random_value


def register() -> None:
    """Tell OmegaConf the words."""
    OmegaConf.register_new_resolver("draw", random_value, replace=True)
    OmegaConf.register_new_resolver("nearest", nearest, replace=True)


def nearest(value: Any, limits: Any) -> Any:
    """The number between two limits that is nearest to a value; the value itself where there are no such limits.

    `${nearest:${speed},${.speeds}}`: the speed that is asked for, as far as it is one of this teacher's.
    """
    try:
        low, high = limits
        return value if low <= value <= high else min(max(value, low), high)
    except (TypeError, ValueError):  # no limits, or wrong ones, which are told of by their own key
        return value
