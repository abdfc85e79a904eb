"""Where a user's own HumEnv files are looked for; tests that need them are skipped without."""

from __future__ import annotations

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[3] / "shared" / "humenv"


def humenv_xml() -> Path:
    """HumEnv's robot.xml."""
    return _present(SHARED / "robot.xml")


def humenv_cases() -> Path:
    """States and HumEnv's observations of them."""
    return _present(SHARED / "observation_cases.npz")


def _present(path: Path) -> Path:
    if not path.is_file():
        pytest.skip(f"{path.name} is not here")
    return path
