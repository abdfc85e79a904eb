"""The policy of a teacher, which fits the reduced-order model that it is to walk, or ArtifactError."""

from __future__ import annotations

from pathlib import Path

from gymnasium.spaces import flatdim

from romgrl.algorithms.ppo_policy import PPOPolicy, load_ppo_policy
from romgrl.config.schema import Config
from romgrl.rom.interface import RomVectorEnv


def read_teacher(directory: Path, config: Config, env: RomVectorEnv) -> PPOPolicy:
    """The policy of the teacher for the reduced-order model that it is to walk."""
    fits: dict[str, object] = {
        "input_size": flatdim(env.single_observation_space),
        "output_size": flatdim(env.single_action_space),
        "hidden_sizes": list(config.teacher.hidden_sizes),
        "activation": config.teacher.activation,
    }
    return load_ppo_policy(directory / "policy.safetensors", fits, env.observation_names)
