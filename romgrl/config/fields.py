"""How a key of the schema is described."""

from __future__ import annotations

from dataclasses import field
from typing import Any

MISSING: Any = "???"


def key(
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Describe one key: low <= value <= high, value > above, or value in choices. The value comes from YAML."""
    metadata = {"doc": doc, "unit": unit, "low": low, "high": high, "above": above, "choices": choices}
    return field(default=MISSING, metadata=metadata)
