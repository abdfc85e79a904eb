"""A user's file: the project's own body, with texts of it exchanged."""

from pathlib import Path

import mujoco
import pytest

from romgrl.humanoid.model import build
from romgrl.humanoid.own_body import human_spec
from tests.humanoid.files import Builder


@pytest.fixture(scope="module")
def text() -> str:
    """A file of the project's own body."""
    spec = human_spec(height=1.741, mass=73.0)
    spec.compile()
    return str(spec.to_xml())


@pytest.fixture
def changed(text: str, tmp_path: Path) -> Builder:
    """The humanoid of that file, each text of `places` replaced by what stands beside it."""

    def make(*places: tuple[str, str], actuation: str = "servo") -> mujoco.MjModel:
        written = text
        for place, instead in places:
            assert place in written
            written = written.replace(place, instead, 1)
        (tmp_path / "file.xml").write_text(written, encoding="utf-8")
        return build(xml=tmp_path / "file.xml", actuation=actuation)

    return make
