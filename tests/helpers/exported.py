"""The student that ships, exported."""

from __future__ import annotations

from pathlib import Path

from romgrl.config.schema import Config
from romgrl.provenance.shipped import PLACE
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import export

SHIPPED = PLACE / "student"


def exported_student(config: Config, output: Path) -> Path:
    """Write the files of stage=export into an empty directory."""
    export.run(config, {"student": SHIPPED}, output, SilentLog())
    return output
