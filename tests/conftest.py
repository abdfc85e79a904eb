"""Fixtures that every test may use."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from romgrl.composition import CONF, register_schema, to_config
from romgrl.config import Config

Composer = Callable[..., Config]


@pytest.fixture(scope="session")
def compose_config() -> Iterator[Composer]:
    """Compose the configuration that a command line with these overrides would give."""
    register_schema()

    def composed(*overrides: str) -> Config:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            return to_config(compose("config", overrides=list(overrides)))

    yield composed
    GlobalHydra.instance().clear()


@pytest.fixture
def smoke_config(compose_config: Composer, tmp_path: Path) -> Config:
    """The smallest configuration, on one thread, with its outputs in the test's directory."""
    return compose_config("experiment=smoke", "threads=1", f"paths.outputs={tmp_path}/outputs")
