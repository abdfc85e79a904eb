"""Fixtures of the fault suite."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from romgrl.tracking.recorder import default_uri
from romgrl.tracking.sending.store import Store


@pytest.fixture(scope="session")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty store, whose tables take seconds to make."""
    directory = tmp_path_factory.mktemp("store")
    store = Store(default_uri(directory), directory)
    store.request("search_experiments")
    store.close()
    return directory / "mlflow.db"


@pytest.fixture
def outputs(tmp_path: Path, database: Path) -> Path:
    """An output directory with a store."""
    shutil.copy(database, tmp_path)
    return tmp_path
