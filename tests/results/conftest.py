"""One composition of the default configuration for all tests of results."""

from __future__ import annotations

import pytest

from romgrl.config.schema import Config
from tests.conftest import Composer


@pytest.fixture(scope="session")
def default_config(compose_config: Composer) -> Config:
    """The configuration without overrides."""
    return compose_config()
