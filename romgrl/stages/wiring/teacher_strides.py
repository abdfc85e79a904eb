"""The strides of a teacher as a return map."""

from __future__ import annotations

from pathlib import Path

from romgrl.config.schema import Config
from romgrl.gait.footfall import FOOTFALLS
from romgrl.rom.return_map import RETURN_MAPS, StrideMap
from romgrl.stages.wiring.commands import asked
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import read_teacher


def teacher_strides(config: Config, directory: Path) -> StrideMap | None:
    """The strides of the teacher's reduced-order model; None where it has no return map."""
    return_map = RETURN_MAPS.get(config.rom.model)
    if return_map is None:
        return None
    env = rom_env(config, num_envs=1, episode_steps=1)
    policy = read_teacher(directory, config, env)
    env.close()
    return return_map(
        policy,
        env.parameters,
        speed=asked(config),
        control_frequency=config.humanoid.control_frequency,
        threads=config.threads,
        top=FOOTFALLS[config.teacher.gait].together,
    )
