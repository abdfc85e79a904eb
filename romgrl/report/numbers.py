"""Numbers as text: with so many decimals where a column is compared, with significant digits where one is read."""

from __future__ import annotations

import math

from romgrl.gait.measures import MEASURES

UNKNOWN = "-"


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals; a dash for what is not known."""
    return f"{value:,.{decimals}f}" if math.isfinite(value) else UNKNOWN


def significant(value: float, digits: int = 3) -> str:
    """A number to so many significant digits; a dash for what is not known."""
    return f"{value:.{digits}g}" if math.isfinite(value) else UNKNOWN


def measured(name: str, value: float) -> str:
    """A number of the gait with the decimals of its measure."""
    return fixed(value, MEASURES[name].decimals)
