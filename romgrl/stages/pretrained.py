"""Teacher, student and baseline that nobody trains: the artifacts that ship with the package."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from romgrl.artifacts import write_bytes
from romgrl.config.schema import Config
from romgrl.provenance import shipped
from romgrl.runtime.stage_log import StageLog, format_duration
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import read_teacher
from romgrl.stages.wiring.walker_policy import read_walker


def teacher(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the teacher that ships, once it fits the reduced-order model."""
    copy("teacher", output, log)
    with closing(rom_env(config, num_envs=1, episode_steps=1)) as env:
        read_teacher(output, config, env)


def student(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the student that ships, once it fits the humanoid."""
    copy_walker("student", config, output, log)


def baseline(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the baseline that ships, once it fits the humanoid."""
    copy_walker("baseline", config, output, log)


def copy_walker(stage: str, config: Config, output: Path, log: StageLog) -> None:
    """Copy a walker of the humanoid. Raises ArtifactError where it is one of another humanoid."""
    copy(stage, output, log)
    with closing(humanoid_env(config, num_envs=1)) as env:
        read_walker(output, env)


def copy(stage: str, output: Path, log: StageLog) -> None:
    """Verify the artifact that ships and copy every file of it; say what made it."""
    manifest = shipped.shipped(stage)
    for name in manifest.files:
        write_bytes(output / name, (shipped.PLACE / stage / name).read_bytes())
    steps = manifest.config.get(f"{shipped.GROUPS[stage]}.total_steps")
    log.message(
        f"pretrained, not trained here: {steps} steps in {format_duration(manifest.wall_time)} with seed "
        f"{manifest.seed}, romgrl {manifest.versions.get('romgrl')}, revision {(manifest.revision or 'unknown')[:12]}"
    )
