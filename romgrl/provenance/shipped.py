"""Trained walkers that ship with the package: artifacts as their stages made them, verified before they are used."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from romgrl.artifacts import Manifest, open_artifact
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.config.values import first_kind, foreign_keys, keys_of, value_of
from romgrl.errors import ArtifactError

PLACE = Path(__file__).resolve().parents[1] / "pretrained"
GROUPS = {"teacher": "teacher", "student": "student", "baseline": "student"}  # whose `pretrained` asks for the walker
CONDITIONED_PLACE = "conditioned"  # in PLACE: what ships of a student that follows commands
CONDITIONED_STAGES = ("teacher", "library", "student")  # of it; a baseline may ship, too
LEARNING = ("teacher.", "student.", "discriminator.", "library.")  # how a walker was trained: not how it runs, but for
RUNNING = (
    *("teacher.speed", "teacher.stiffness_share", "teacher.hidden_sizes", "teacher.activation"),
    *("student.standing_share", "student.taught_step"),
)


def follows_shipped(config: Config) -> bool:
    """Tell whether the student is the one that follows commands and ships."""
    return is_conditioned(config) and config.student.pretrained


def shipped_stages(config: Config) -> tuple[str, ...]:
    """The stages that a configuration needs from the package."""
    stages = CONDITIONED_STAGES if follows_shipped(config) else tuple(GROUPS)
    return tuple(stage for stage in stages if is_pretrained(stage, config))


def shipped_directory(stage: str, *, conditioned: bool = False) -> Path:
    """Where what ships for a stage lies, of a student that is conditioned or not."""
    return (PLACE / CONDITIONED_PLACE if conditioned else PLACE) / stage


def is_pretrained(stage: str, config: Config) -> bool:
    """Tell whether a stage takes its artifact from the package."""
    if follows_shipped(config):
        return stage in (*CONDITIONED_STAGES, "baseline")
    return stage in GROUPS and bool(value_of(config, f"{GROUPS[stage]}.pretrained"))


def shipped(stage: str, *, conditioned: bool = False) -> Manifest:
    """The verified manifest of the artifact that ships for a stage. Raises ArtifactError."""
    try:
        return open_artifact(shipped_directory(stage, conditioned=conditioned), stage=stage)
    except ArtifactError as error:
        if conditioned:
            made = "`make pretrained_conditioned` trains and packs it, and student=conditioned trains one of your own"
            raise ArtifactError(f"{error}; it may not ship yet: {made}") from error
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
    for stage in shipped_stages(config):
        shipped(stage, conditioned=follows_shipped(config))


def matters(key: str) -> bool:
    """Tell whether a setting of the training must be the one that a walker is run with."""
    return key in RUNNING or not (key == "device" or key.startswith(LEARNING))


def other_settings(stage: str, config: Config) -> Iterator[tuple[str, Any, Any]]:
    """Yield the settings that matter and are not those of the training: key, value and the value in the training."""
    known, foreign = keys_of(config), foreign_keys(lambda key: value_of(config, key))
    made_from = shipped(stage, conditioned=follows_shipped(config)).config
    for key, trained in made_from.items():
        if key in known and matters(key) and value_of(config, key) != trained:
            yield key, value_of(config, key), trained
        elif key in foreign:  # of another kind than in the training, which the manifest may not name
            kind = made_from.get(foreign[key], first_kind(foreign[key]))
            yield foreign[key], value_of(config, foreign[key]), kind
