"""How high the jumps of a teacher are beside what its configuration asks for."""

from __future__ import annotations

from typing import Any

from romgrl.config.schema import Config
from romgrl.gait.features import Gait
from romgrl.gait.jumps import describe_jumps
from romgrl.rom.parameters import standing_height


def jumps_asked(config: Config, gait: Gait, parameters: Any) -> dict[str, float]:
    """`romgrl.gait.jumps.JUMP_MEASURES` of the valid steps; nothing where no jumps are asked for."""
    if not config.teacher.apex:
        return {}
    return describe_jumps(gait, asked=config.teacher.apex, standing=standing_height(parameters))
