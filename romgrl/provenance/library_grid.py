"""Which cells a library has: the speeds, apexes and stiffnesses that its teacher is asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

from romgrl.config.schema import Config
from romgrl.config.teachers import has_range


def library_cells(config: Config) -> list[Config]:
    """The configuration of each cell: speeds and apexes that are multiples of a step within a range, each stiffness."""
    teacher, asked = config.teacher, config.library
    if not has_range(teacher):
        return [config]
    speeds = [teacher.speed] if teacher.speeds is None else multiples(teacher.speeds, asked.speed_step)
    apexes = [teacher.apex] if teacher.apexes is None else multiples(teacher.apexes, asked.apex_step)
    shares = [teacher.stiffness_share] if teacher.stiffness_shares is None else [*dict.fromkeys(asked.stiffness_shares)]
    return [
        replace(config, teacher=replace(teacher, speed=speed, apex=apex, stiffness_share=share))
        for speed, apex, share in product(speeds, apexes, shares)
    ]


def multiples(ends: Sequence[float], step: float) -> list[float]:
    """Those of a step within a range; its lower end where there is none."""
    low, high = ends
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(number * step, 9) for number in range(first, last + 1)] or [low]
