"""What several tests of stages look at: the student that ships, and one that follows commands, exported."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.config.schema import Config
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import export
from tests.conftest import Composer
from tests.helpers.commanded import commanded, shipped_follower, small_library
from tests.helpers.exported import SHIPPED


@pytest.fixture(scope="session")
def exported(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of stage=export for `student=pretrained`."""
    output = tmp_path_factory.mktemp("export")
    export.run(compose_config("student=pretrained", "threads=1"), {"student": SHIPPED}, output, SilentLog())
    return output


@pytest.fixture(scope="session")
def follower(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> tuple[Config, dict[str, Path]]:
    """A student that follows commands, as far as a test needs one, and its library."""
    place = tmp_path_factory.mktemp("follower")
    config = commanded(compose_config, "stage=export", "speed=2.3", "humanoid.episode_steps=1000")
    return config, {
        "student": shipped_follower(place / "student", config),
        "library": small_library(place / "library"),
    }


@pytest.fixture(scope="session")
def exported_follower(follower: tuple[Config, dict[str, Path]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of stage=export for it."""
    output = tmp_path_factory.mktemp("export_of_follower")
    export.run(*follower, output, SilentLog())
    return output
