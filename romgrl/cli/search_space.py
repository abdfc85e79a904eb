"""Points of a search: random ones that YAML draws, and the scales from which Optuna chooses.

`${draw:SEED,NAME,LOW,HIGH}` or `${draw:SEED,NAME,LOW,HIGH,log}`: a number is fixed by seed and name, so that a search
that was stopped goes on with the points that it began with, in any order and in any process, and its stages keep their
keys. `interval(LOW,HIGH)`, `tag(log,interval(LOW,HIGH))`, `range(...)` and lists are Hydra's words for a scale.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from hydra.core.override_parser.types import Override

from romgrl.config.values import kind_of, schema_keys

DIGITS = 4  # significant; what is written down of a point is the point


def random_value(seed: int, name: str, low: float, high: float, scale: str = "linear") -> float:
    """A number in [low, high], uniform in itself or, with scale `log`, in its logarithm. Raises ValueError."""
    if not low < high or scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise ValueError(f"draw needs low < high (above 0 for log) and linear or log, not {low}, {high}, {scale}")
    share = int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8]) / 2**64
    value = low * (high / low) ** share if scale == "log" else low + share * (high - low)
    return rounded(value)


def rounded(value: float) -> float:
    """A number with as many digits as a point has."""
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True)
class Scale:
    """What a search may give a key: one of `choices`, as overrides have them, or without any a number in [low, high].

    `whole`: whole numbers alone. `log`: uniform in the logarithm.
    """

    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 0.0
    whole: bool = False
    log: bool = False

    @property
    def probes(self) -> tuple[str, ...]:
        """Values that stand for all: every choice, or both ends."""
        return self.choices or (str(self.low), str(self.high))

    def written(self, value: Any) -> str:
        """A value as overrides have it; a number rounded, and inside even then."""
        if self.choices or self.whole:
            return str(value)
        return str(min(max(rounded(value), self.low), self.high))


def scale_from(override: Override) -> Scale:
    """The scale of a key that a search varies: an interval, or a list or range of values without an order."""
    if not override.is_interval_sweep():
        return Scale(tuple(dict.fromkeys(override.sweep_string_iterator())))
    interval: Any = override.value()
    whole = kind_of(schema_keys()[override.key_or_group]).item == "int"
    return Scale((), interval.start, interval.end, whole, "log" in interval.tags)
