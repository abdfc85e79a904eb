"""What several tests of stages look at: the student that ships, exported."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import export
from tests.conftest import Composer
from tests.helpers.exported import SHIPPED


@pytest.fixture(scope="session")
def exported(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of stage=export for `student=pretrained`."""
    output = tmp_path_factory.mktemp("export")
    export.run(compose_config("student=pretrained", "threads=1"), {"student": SHIPPED}, output, SilentLog())
    return output
