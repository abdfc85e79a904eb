"""The key of each stage: what it is made from decides where it is stored."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from romgrl.artifacts import read_manifest
from romgrl.config.commanded import ConditionedStudent, is_conditioned
from romgrl.config.schema import Config
from romgrl.config.teachers import COMMANDS
from romgrl.config.values import value_of
from romgrl.config.worlds import Humanoid
from romgrl.errors import ArtifactError
from romgrl.provenance.cycles import cycle_identity
from romgrl.provenance.shipped import GROUPS, follows_shipped, is_pretrained, shipped, shipped_digest
from romgrl.provenance.source_digest import source_digest
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.versions import computing_versions

NAMED = ("rom", "teacher", "humanoid", "student", "discriminator")
NAME_KEYS = tuple(f"{group}.name" for group in NAMED)  # say what was chosen, change nothing


def stage_config(stage: str, config: Config) -> Config:
    """The configuration that a stage sees: without imitation for the baseline and where there is no discriminator."""
    imitates = stage != "baseline" and config.discriminator.enabled
    if isinstance(config.student, ConditionedStudent) and (config.eta == 1 or not imitates):
        config = replace(config, student=replace(config.student, final_eta=None))
    if not imitates:
        silent = replace(config.discriminator, enabled=False, features="paper", window=1, stride=1, reward="recomputed")
        resets = config.student.reference_resets if is_conditioned(config) else 0.0
        student = replace(config.student, reference_resets=resets, adapt_eta=False, end_early=False, second_try=False)
        if isinstance(student, ConditionedStudent):
            student = replace(student, mismatched_share=0.0, mismatch_distance=1.0)
            student = replace(student, stratify=False, standardize_by_command=False)
        if stage == "baseline":
            student = replace(student, posture_weight=0.0, kept_policy="task_reward")
        return replace(config, eta=1.0, noise=0.0, discriminator=silent, student=student)
    return config


def stage_settings(stage: str, config: Config) -> dict[str, Any]:
    """The keys that the stage depends on, with their values; a model file counts as what it describes.

    Cycles count as the teacher that they are of. Raises ArtifactError where that is none.
    """
    if is_pretrained(stage, config):
        return pretrained_settings(stage, conditioned=follows_shipped(config))
    config = stage_config(stage, config)
    settings: dict[str, Any] = {}
    for key in STAGES[stage].depends_on(conditioned=is_conditioned(config)):
        value = value_of(config, key)
        nested = hasattr(value, "__dataclass_fields__")
        settings |= {f"{key}.{name}": item for name, item in asdict(value).items()} if nested else {key: value}
    if is_conditioned(config) and STAGES[stage].conditioned is not None:  # asked for more than speed
        settings = {name: value for name, value in settings.items() if name not in ("speed", "teacher.speed")}
        settings |= {name: value_of(config, name) for name in STAGES[stage].asks}
    elif settings.get("student.kind") == "one_speed":  # as the keys of all that was trained before there was another
        del settings["student.kind"]
    if stage in ("teacher", "library"):  # of a range, both are the same whichever of it is asked for later
        for name, of in COMMANDS.items():
            if settings[f"teacher.{of}"] is not None:
                del settings[f"teacher.{name}"]
    if settings.get("library.others") is not None:
        settings["library.others"] = libraries_read(config)
    if "evaluation.specialists" in settings:  # no key of what was evaluated before there were any
        del settings["evaluation.specialists"]
        settings |= specialists_read(config)
    if stage == "student" and not config.discriminator.enabled:
        settings = {name: value for name, value in settings.items() if not name.startswith("discriminator.")}
        settings["discriminator.enabled"] = False
    if settings.get("teacher.cycles") is not None:
        settings["teacher.cycles"] = cycle_identity(settings["teacher.cycles"])
    if settings.get("humanoid.xml") is not None:
        del settings["humanoid.xml"]
        settings |= body_settings(stage, config)
    return {name: settings[name] for name in sorted(settings.keys() - set(NAME_KEYS))}


def libraries_read(config: Config) -> list[str]:
    """Key and digest of each library that is joined with this one; places do not count. Raises ArtifactError."""
    manifests = [read_manifest(Path(place)) for place in config.library.others or ()]
    return [f"{manifest.key} sha256:{manifest.digest}" for manifest in manifests]


def specialists_read(config: Config) -> dict[str, Any]:
    """Key and digest of each evaluation of `evaluation.specialists`, by the name of that key; empty where there are
    none. Raises ArtifactError."""
    manifests = [read_manifest(Path(place)) for place in config.evaluation.specialists or ()]
    found = [f"{manifest.key} sha256:{manifest.digest}" for manifest in manifests]
    return {"evaluation.specialists": found} if found else {}


def body_settings(stage: str, config: Config) -> dict[str, Any]:
    """What a stage depends on in the model that a file describes, compiled: included files count, their places do not.

    The reduced-order model takes its sizes alone, and colours count where they are drawn. Raises ConfigurationError.
    """
    sizes, physics, full = body_digests(json.dumps(asdict(config.humanoid)))
    described = {"humanoid.sizes": sizes}
    if "humanoid" not in STAGES[stage].depends_on(conditioned=is_conditioned(config)):
        return described
    return described | {"humanoid.xml": f"sha256:{full if stage == 'report' else physics}"}


@lru_cache(maxsize=1)
def body_digests(humanoid: str) -> tuple[str, str, str]:
    """Sizes and the digests of physics and of all of a model file, compiled once for all stages of a job."""
    from romgrl.humanoid import digest, model  # MuJoCo takes a moment to import
    from romgrl.humanoid.process_settings import set_up_mujoco

    set_up_mujoco()
    body = model.configured(Humanoid(**json.loads(humanoid)))
    sizes = model.dimensions(body)
    text = f"{sizes.mass:.9g} kg, leg {sizes.leg_length:.9g} m, ankle {sizes.ankle_height:.9g} m"
    return text, digest.physics_digest(body), digest.full_digest(body)


def require_same_body(config: Config) -> None:
    """Raise ArtifactError where the model file is not what it was when the keys of the job were made."""
    humanoid = json.dumps(asdict(config.humanoid))
    if config.humanoid.xml is not None and body_digests.__wrapped__(humanoid) != body_digests(humanoid):
        raise ArtifactError(f"{config.humanoid.xml}: the model changed while the job ran; the same command starts anew")


def require_same_libraries(config: Config, settings: Mapping[str, Any]) -> None:
    """Raise ArtifactError where a library is not what it was when the settings of the joined one were made."""
    if is_pretrained("library", config):  # it ships joined
        return
    if settings.get("library.others") is not None and settings["library.others"] != libraries_read(config):
        raise ArtifactError("library.others: a library changed while the job ran; the same command starts anew")


def pretrained_settings(stage: str, *, conditioned: bool) -> dict[str, Any]:
    """The settings of the training that made what ships, and the digest of it. Raises ArtifactError."""
    manifest = shipped(stage, conditioned=conditioned)
    asked_by = "student" if conditioned else GROUPS[stage]
    settings = manifest.config | {f"{asked_by}.pretrained": f"sha256:{manifest.digest}"}
    return {name: settings[name] for name in sorted(settings)}


def stage_function(stage: str, config: Config) -> str:
    """The function that makes a stage, as `module:function`."""
    if is_pretrained(stage, config):
        return f"romgrl.stages.pretrained:{stage}"
    return STAGES[stage].made_by(conditioned=is_conditioned(config))


def stage_key(stage: str, config: Config, upstream: Mapping[str, str]) -> str:
    """SHA-256 (16 hexadecimal digits) over all that decides what a stage makes.

    That is the stage's settings, its code, the versions of what computes, the digests of the artifacts it reads, and
    of what ships that it compares with.
    """
    read = dict(upstream) | {f"shipped {name}": shipped_digest(name) for name in STAGES[stage].beside}
    document = {
        "stage": stage,
        "settings": stage_settings(stage, config),
        "sources": source_digest(stage_function(stage, config), drawing=STAGES[stage].drawn),
        "versions": computing_versions(),
        "upstream": read,
    }
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
