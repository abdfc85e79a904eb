"""Functions that are named as text: module:function."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any


def load_function(entry: str) -> Callable[..., Any]:
    """Import `module:function`."""
    module, _, name = entry.partition(":")
    function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function
