"""Teacher, library, student and baseline that nobody makes: the artifacts that ship with the package."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from romgrl.artifacts import write_bytes
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.provenance import shipped
from romgrl.runtime.stage_log import StageLog, format_duration
from romgrl.stages.conditioned.asked_at_first import read_command_limits
from romgrl.stages.conditioned.command_keys import PressedKeys
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.rom import rom_env
from romgrl.stages.wiring.teacher_policy import read_teacher
from romgrl.stages.wiring.walker_policy import read_walker


def teacher(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the teacher that ships, once it fits the reduced-order model."""
    copy("teacher", config, output, log)
    with closing(rom_env(config, num_envs=1, episode_steps=1)) as env:
        read_teacher(output, config, env)


def library(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the cells that taught the conditioned student that ships, once they fit the settings."""
    copy("library", config, output, log)
    read_command_limits(shipped.shipped_directory("library", conditioned=True), config)


def student(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the student that ships, once it fits the humanoid, and the library where it is conditioned."""
    copy_walker("student", config, inputs, output, log)


def baseline(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy the baseline that ships, once it fits the same."""
    copy_walker("baseline", config, inputs, output, log)


def copy_walker(stage: str, config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Copy a walker of the humanoid. Raises ArtifactError where it is one of another humanoid or other commands."""
    copy(stage, config, output, log)
    limits = read_command_limits(inputs["library"], config) if is_conditioned(config) else None
    commands = None if limits is None else PressedKeys(limits, limits.slowest)
    with closing(humanoid_env(config, num_envs=1, commands=commands)) as env:
        read_walker(output, env)


def copy(stage: str, config: Config, output: Path, log: StageLog) -> None:
    """Verify the artifact that ships and copy every file of it; say what made it."""
    conditioned = shipped.follows_shipped(config)
    manifest = shipped.shipped(stage, conditioned=conditioned)
    for name in manifest.files:
        path = shipped.shipped_directory(stage, conditioned=conditioned) / name
        write_bytes(output / name, path.read_bytes())
    steps = manifest.config.get(f"{'teacher' if stage == 'teacher' else 'student'}.total_steps")
    trained = "made here: finished" if steps is None else f"trained here: {steps} steps"
    log.message(
        f"pretrained, not {trained} in {format_duration(manifest.wall_time)} with seed "
        f"{manifest.seed}, romgrl {manifest.versions.get('romgrl')}, revision {(manifest.revision or 'unknown')[:12]}"
    )
