"""What a finished conditioned student may be asked for, by its library, and with which command it begins."""

from __future__ import annotations

from pathlib import Path

from romgrl.config.commanded import conditioned_keys
from romgrl.config.schema import Config
from romgrl.humanoid.command_limits import AskedCommand, CommandLimits
from romgrl.stages.conditioned.cells import read_command_cells


def read_command_limits(library: Path, config: Config) -> CommandLimits:
    """The speeds of its cells. Raises ArtifactError for a library that can teach nothing."""
    cells = read_command_cells(library, config, span=1)
    asked = ((cells.gaits[gait], float(speed)) for gait, speed in zip(cells.gait, cells.speed, strict=True))
    return CommandLimits.of(asked, conditioned_keys(config.student).standing_share)


def first_command(limits: CommandLimits, config: Config) -> AskedCommand:
    """At `speed`, in the gait of the teacher where that has it. Raises ConfigurationError."""
    return limits.begun(config.speed, config.teacher.gait)


def require_first_command(config: Config, library: Path) -> None:
    """Raise ConfigurationError where a student of this library cannot be asked for `speed`."""
    first_command(read_command_limits(library, config), config)
