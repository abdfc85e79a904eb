"""All rows, in the order of the table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.measure import Options, Result
from benchmarks.rows import sac


@dataclass(frozen=True)
class Row:
    """What a row says, and the function that measures it."""

    title: str
    measure: Callable[[Options], Result]


ROWS: dict[str, Row] = {
    "sac_vs_sb3": Row("SAC update beside Stable-Baselines3's", sac.against_sb3),
    "sac_vs_cleanrl": Row("SAC update beside CleanRL's", sac.against_cleanrl),
    "sac_flops_same_shapes": Row("SAC update: useful FLOPs beside sgemm at the same shapes", sac.flops_same_shapes),
    "sac_flops_square": Row("SAC update: useful FLOPs beside sgemm at a large square", sac.flops_square),
}
