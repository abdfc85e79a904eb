"""Random points of a sweep, written in YAML: `${draw:SEED,NAME,LOW,HIGH}` or `${draw:SEED,NAME,LOW,HIGH,log}`.

A number is fixed by seed and name, so that a search that was stopped goes on with the points that it began with, in
any order and in any process, and its stages keep their keys.
"""

from __future__ import annotations

import hashlib

from omegaconf import OmegaConf

DIGITS = 4  # significant; what is written down of a point is the point


def register() -> None:
    """Tell OmegaConf the word `draw`."""
    OmegaConf.register_new_resolver("draw", random_value, replace=True)


def random_value(seed: int, name: str, low: float, high: float, scale: str = "linear") -> float:
    """A number in [low, high], uniform in itself or, with scale `log`, in its logarithm. Raises ValueError."""
    if not low < high or scale not in ("linear", "log") or (scale == "log" and low <= 0):
        raise ValueError(f"draw needs low < high (above 0 for log) and linear or log, not {low}, {high}, {scale}")
    share = int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8]) / 2**64
    value = low * (high / low) ** share if scale == "log" else low + share * (high - low)
    return float(f"{value:.{DIGITS}g}")
