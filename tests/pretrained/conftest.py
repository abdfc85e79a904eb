"""What is shipped for the tests of the package's walkers, once for all of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from romgrl.pipeline import run as pipeline
from romgrl.pretrained.__main__ import main
from romgrl.provenance import shipped as what_ships
from romgrl.provenance import stage_graph
from tests.conftest import Composer
from tests.helpers import untrained

SMALL = ("experiment=smoke", "stage=evaluation", "tracking=none", "threads=1")


@pytest.fixture(scope="package")
def outputs(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation of walkers that have learned nothing, and all that it needs."""
    found, saved = tmp_path_factory.mktemp("outputs"), dict(stage_graph.STAGES)
    untrained.replace_trainings()
    pipeline.run(compose_config(*SMALL, f"paths.outputs={found}"))
    stage_graph.STAGES.update(saved)
    return found


@pytest.fixture(scope="package")
def place(outputs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the command put what it found there."""
    found = tmp_path_factory.mktemp("package")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(what_ships, "PLACE", found)
        assert main([str(outputs), "experiment=smoke"]) == 0
    return found


@pytest.fixture
def shipped(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of what ships, that the package takes for its own."""
    shutil.copytree(place, tmp_path / "package")
    monkeypatch.setattr(what_ships, "PLACE", tmp_path / "package")
    return tmp_path / "package"
