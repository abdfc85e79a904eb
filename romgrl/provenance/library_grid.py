"""Which cells a library has: the speeds and stiffnesses that its teacher is asked for."""

from __future__ import annotations

import math
from dataclasses import replace

from romgrl.config.schema import Config


def library_cells(config: Config) -> list[Config]:
    """The configuration of each cell: speeds that are multiples of a step within the range, and each stiffness."""
    teacher, step = config.teacher, config.library.speed_step
    if teacher.speeds is None and teacher.stiffness_shares is None:
        return [config]
    speeds = [teacher.speed]
    if teacher.speeds is not None:
        low, high = teacher.speeds
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        speeds = [number * step for number in range(first, last + 1)] or [low]
    shares = [teacher.stiffness_share] if teacher.stiffness_shares is None else config.library.stiffness_shares
    return [
        replace(config, teacher=replace(teacher, speed=speed, stiffness_share=share))
        for speed in speeds
        for share in shares
    ]
