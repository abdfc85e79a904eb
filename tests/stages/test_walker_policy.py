"""A walker reads the columns that it was trained on, by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.errors import ArtifactError
from romgrl.humanoid.model import identity
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.stages.wiring.walker_policy import read_walker
from tests.helpers.walkers import write_walker


def test_columns_by_other_names_are_refused(tmp_path: Path) -> None:
    env, path = PlanarHumanoidVectorEnv(), tmp_path / "policy.safetensors"
    humanoid, names = identity(env.model), list(env.observation_names[:10])
    write_walker(path, humanoid=humanoid)
    assert read_walker(tmp_path, env).names is None  # as files of old
    write_walker(path, humanoid=humanoid, names=names)
    assert read_walker(tmp_path, env).names == names
    names[2], names[3] = names[3], names[2]
    write_walker(path, humanoid=humanoid, names=names)
    with pytest.raises(ArtifactError, match=f"column 2 of what it reads is {names[2]}; needed: {names[3]}"):
        read_walker(tmp_path, env)
