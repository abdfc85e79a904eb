"""Users' files: HumEnv's, where they are looked for (tests that need them are skipped without), and one of our body."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

Builder = Callable[..., mujoco.MjModel]
"""The humanoid of a file of the project's own body, texts of it exchanged."""
TOE = 'name="L_Toe" joint="L_Toe" ctrlrange="-0.3 0.3" ctrllimited="true" forcelimited="true" forcerange="-40 40"'
"""Of the toe's servo in that file."""

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
