"""The policy of student or baseline, which fits the humanoid that it is to walk, or ArtifactError."""

from __future__ import annotations

from pathlib import Path

from gymnasium.spaces import flatdim

from romgrl.algorithms import sac
from romgrl.algorithms.policy_file import require_names
from romgrl.errors import ArtifactError
from romgrl.humanoid.model import identity
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv


def read_walker(directory: Path, env: PlanarHumanoidVectorEnv) -> sac.SACPolicy:
    """The policy of student or baseline for the humanoid that it is to walk."""
    path = directory / "policy.safetensors"
    policy = sac.load_sac_policy(path, humanoid=identity(env.model))
    actions, observations = policy.policy.sizes[-1] // 2, flatdim(env.single_observation_space)
    if policy.policy.sizes[-1] != 2 * env.model.nu:
        raise ArtifactError(f"{path}: {actions} actions; needed: {env.model.nu}")
    low, high = int(policy.columns.min()), int(policy.columns.max())
    if low < 0 or high >= observations:
        raise ArtifactError(f"{path}: observation columns from {low} to {high}; needed: below {observations}")
    require_names(path, policy.names, [env.observation_names[column] for column in policy.columns.tolist()])
    return policy
