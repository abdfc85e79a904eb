"""One composition of the default configuration for all tests of results, and no sweep that outlives its test."""

from __future__ import annotations

import pytest

from romgrl.config.schema import Config
from romgrl.results.sweep_record import SWEEP_VARIABLE
from tests.conftest import Composer


@pytest.fixture(scope="session")
def default_config(compose_config: Composer) -> Config:
    """The configuration without overrides."""
    return compose_config()


@pytest.fixture(autouse=True)
def _sweep_of_one_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test's sweep tells its jobs is forgotten with the test."""
    monkeypatch.setenv(SWEEP_VARIABLE, "")
