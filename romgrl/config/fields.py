"""How a key of the schema is described."""

from __future__ import annotations

from collections.abc import Collection, Mapping
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
    choices: Collection[str] = (),
    span: bool = False,
    before: Any = MISSING,
) -> Any:
    """Describe one key: low <= value <= high, value > above, or value in choices. The value comes from YAML.

    `span`: a list of two numbers, the ends of a range. `before`: what holds for artifacts that are older than the
    key; a tuple: any of these, which made no difference then.
    """
    told = {"doc": doc, "unit": unit, "choices": choices, "span": span, "before": before}
    return field(default=MISSING, metadata={**told, "low": low, "high": high, "above": above})


def one_of(kinds: Mapping[str, type], by: str) -> Any:
    """A group whose keys depend on what its key `by` says; the first kind where it says nothing.

    A key that several kinds have means the same in each.
    """
    return field(default_factory=next(iter(kinds.values())), metadata={"kinds": kinds, "by": by})
