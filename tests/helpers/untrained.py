"""Stages that save walkers which have learned nothing, and what ships of such walkers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from romgrl.algorithms.ppo_policy import save_ppo_policy
from romgrl.artifacts import Manifest, write_manifest
from romgrl.config.schema import Config
from romgrl.humanoid.model import configured, fingerprint
from romgrl.provenance import stage_graph
from romgrl.provenance.shipped import GROUPS
from romgrl.provenance.stage_keys import stage_settings
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_learner import build_teacher_learner
from tests.helpers.walkers import write_walker


def teacher(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    with closing(rom_env(config, num_envs=1, episode_steps=10)) as env:
        save_ppo_policy(output / "policy.safetensors", build_teacher_learner(config, env))
    log.metrics({"speed": 1.0}, 10)


def student(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    write_walker(output / "policy.safetensors", humanoid=fingerprint(configured(config.humanoid)), seed=len(inputs))


baseline = student


def never(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    raise AssertionError(f"{output.parent.name} was trained")


def replace_trainings(function: str = "") -> None:
    """Put these functions, or one of them for all, in the place of the trainings."""
    for name in GROUPS:
        stage = stage_graph.STAGES[name]
        stage_graph.STAGES[name] = replace(stage, function=f"{__name__}:{function or name}")


def write_shipped(place: Path, config: Config) -> Path:
    """Write what ships as manifests of trainings with this configuration; returns where."""
    for stage in GROUPS:
        (place / stage).mkdir(parents=True)
        (place / stage / "content.txt").write_text(stage, encoding="utf-8")
        settings = json.loads(json.dumps(stage_settings(stage, config)))
        facts = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 0, "wall_time": 1.0}
        write_manifest(place / stage, stage=stage, key="0" * 16, config=settings, **facts)
    return place


def rewrite(directory: Path, manifest: Manifest) -> None:
    """Describe the files of a directory anew, as what they were made as before."""
    facts = {name: value for name, value in vars(manifest).items() if name not in ("files", "format")}
    write_manifest(directory, **facts)
