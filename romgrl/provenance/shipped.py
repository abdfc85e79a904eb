"""Trained walkers that ship with the package: artifacts as their stages made them, verified before they are used."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from romgrl.artifacts import Manifest, open_artifact
from romgrl.config.schema import Config
from romgrl.config.values import first_kind, foreign_keys, keys_of, value_of
from romgrl.errors import ArtifactError

PLACE = Path(__file__).resolve().parents[1] / "pretrained"
GROUPS = {"teacher": "teacher", "student": "student", "baseline": "student"}  # whose `pretrained` asks for the walker
LEARNING = ("teacher.", "student.", "discriminator.")  # how a walker was trained: nothing that it is run with, but for
RUNNING = ("teacher.speed", "teacher.stiffness_share", "teacher.hidden_sizes", "teacher.activation")


def is_pretrained(stage: str, config: Config) -> bool:
    """Tell whether a stage takes its walker from the package."""
    return stage in GROUPS and bool(value_of(config, f"{GROUPS[stage]}.pretrained"))


def shipped(stage: str) -> Manifest:
    """The verified manifest of the artifact that ships for a stage. Raises ArtifactError."""
    try:
        return open_artifact(PLACE / stage, stage=stage)
    except ArtifactError as error:
        raise ArtifactError(
            f"{error}; a pretrained {stage} comes with romgrl: install it anew, or train one"
        ) from error


def shipped_digest(stage: str) -> str | None:
    """The digest of the artifact that ships for a stage; None where it is not there, or damaged."""
    try:
        return shipped(stage).digest
    except ArtifactError:
        return None


def require_shipped(config: Config) -> None:
    """Raise ArtifactError unless every walker that a configuration takes from the package is there, and whole."""
    for stage in GROUPS:
        if is_pretrained(stage, config):
            shipped(stage)


def matters(key: str) -> bool:
    """Tell whether a setting of the training must be the one that a walker is run with."""
    return key in RUNNING or not (key == "device" or key.startswith(LEARNING))


def other_settings(stage: str, config: Config) -> Iterator[tuple[str, Any, Any]]:
    """Yield the settings that matter and are not those of the training: key, value and the value in the training."""
    known, foreign = keys_of(config), foreign_keys(lambda key: value_of(config, key))
    for key, trained in shipped(stage).config.items():
        if key in known and matters(key) and value_of(config, key) != trained:
            yield key, value_of(config, key), trained
        elif key in foreign:  # of another kind than in the training, which the manifest may not name
            kind = shipped(stage).config.get(foreign[key], first_kind(foreign[key]))
            yield foreign[key], value_of(config, foreign[key]), kind
