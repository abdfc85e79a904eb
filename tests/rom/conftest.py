"""Tests that ask for `engine` run once with each engine of the reduced-order model."""

import pytest

from tests.helpers import rom_worlds


@pytest.fixture(params=["box2d", "native"])
def engine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The engine's name; worlds of `core_parameters` have it."""
    monkeypatch.setattr(rom_worlds, "ENGINE", request.param)
    return str(request.param)
