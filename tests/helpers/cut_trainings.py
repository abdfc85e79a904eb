"""Small real trainings that can be cut anywhere, and digests of all that they end with."""

from __future__ import annotations

import hashlib
import json
import signal
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from romgrl.artifacts import save_arrays
from romgrl.artifacts.checkpoint import flatten_state
from romgrl.config.schema import Config
from romgrl.pipeline import worker
from romgrl.runtime import signals
from romgrl.runtime.stage_log import TerminalLog
from romgrl.stages import student, teacher
from romgrl.stages.training import gait_check
from romgrl.stages.training.checkpoints import TrainingCheckpoints
from tests.conftest import Composer

TEACHER = (
    "threads=1",
    "teacher.total_steps=8192",
    "teacher.num_envs=8",
    "teacher.rollout_steps=32",
    "teacher.minibatch_size=128",
    "teacher.hidden_sizes=[32]",
    "teacher.episode_steps=100",
)
STUDENT = (
    "threads=1",
    "student.hidden_sizes=[32,32]",
    "student.num_envs=8",
    "student.total_steps=3200",
    "student.learning_starts=400",
    "student.batch_size=32",
    "student.buffer_size=1600",
    "student.updates_per_step=0.15",
    "student.check_steps=400",
    "discriminator.batch_size=32",
    "discriminator.hidden_sizes=[32,16]",
    "discriminator.recent_steps=400",
    "humanoid.episode_steps=20",
)
TOTAL = {"teacher": 8192, "student": 3200}


def training(name: str, compose: Composer, *overrides: str) -> Config:
    """The configuration of a training of TOTAL steps; the buffer of the student wraps around."""
    return compose(*(TEACHER if name == "teacher" else STUDENT), *overrides)


def write_reference(directory: Path) -> Path:
    """Feet that swing in antiphase under a bouncing body."""
    directory.mkdir(exist_ok=True)
    phase = 2 * np.pi * 1.6 * np.arange(600) / 30
    left, right = np.sin(phase), np.sin(phase + np.pi)
    features = np.stack(
        (0.95 + 0.04 * np.cos(2 * phase), 0.4 * left, -0.85 + 0.05 * left, 0.4 * right, -0.85 + 0.05 * right), axis=-1
    )
    arrays = {"features": features.astype(np.float32), "episode": np.repeat(np.arange(3), 200).astype(np.int32)}
    save_arrays(directory / "reference.npz", arrays | {"dt": 1 / 30, "speed": 4.0})
    return directory


def train(name: str, config: Config, output: Path) -> None:
    """Run the training in this process, as the pipeline does."""
    output.mkdir(exist_ok=True)
    inputs = {} if name == "teacher" else {"reference": write_reference(output.parent / "reference")}
    with TerminalLog(name, output) as log:
        worker.execute(f"romgrl.stages.{name}:run", config, inputs, output, log)


def interrupt(name: str, config: Config, output: Path, recorder: Recorder, step: int) -> int:
    """Run the training until a signal ends it at a step, and return the last one; what comes next is a new process."""
    recorder.again()
    recorder.cut = step
    with pytest.raises(signals.Interrupted):
        train(name, config, output)
    last = recorder.steps[-1]
    recorder.again()
    return last


class Recorder:
    """Watches the end of every pass of a training loop; cuts it with a signal where told to."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.cut: int | None = None
        self.steps: list[int] = []
        self.state = ""
        self.spoil: Callable[[dict[str, Any]], None] | None = None
        keep, load = TrainingCheckpoints.save_if_due, TrainingCheckpoints.resume

        def watched(checkpoints: TrainingCheckpoints, step: int) -> None:
            self.steps.append(step)
            self.state = digest({name: part.state() for name, part in checkpoints._parts.items()} | rows(checkpoints))
            if self.cut is not None and step >= self.cut:
                self.cut = None
                signals._answer(signal.SIGTERM, None)
            keep(checkpoints, step)

        patch.setattr(TrainingCheckpoints, "save_if_due", watched)
        patch.setattr(signals, "_pending", None)
        patch.setattr(signals, "_once", False)
        patch.setattr(teacher, "CHECK_EPISODES", 2)
        patch.setattr(teacher, "STEPS", 60)
        patch.setattr(teacher, "STEADY", 60)
        patch.setattr(student, "LOG_INTERVAL", 64)
        patch.setattr(gait_check, "EPISODES", 4)
        patch.setattr(gait_check, "STEPS", 30)
        self.patch, self.load = patch, load

    def again(self) -> None:
        """Forget the signal, as a new process does."""
        self.patch.setattr(signals, "_pending", None)
        self.steps = []


def rows(checkpoints: TrainingCheckpoints) -> dict[str, Any]:
    """What is in the replay buffer."""
    ring: Any = checkpoints._checkpoints._ring
    return {} if ring is None else {"ring": ring.read_rows(max(0, ring.added - ring.rows), ring.added)}


def digest(state: Mapping[str, Any]) -> str:
    """SHA-256 over names and bits of a nested state."""
    sha256 = hashlib.sha256()
    for name, value in sorted(flatten_state(state)):
        sha256.update(name.encode())
        if isinstance(value, torch.Tensor | np.ndarray):
            sha256.update(np.ascontiguousarray(np.asarray(value)).tobytes())
        else:
            sha256.update(json.dumps(value).encode())
    return sha256.hexdigest()


def files(output: Path) -> dict[str, str]:
    """SHA-256 of what a training left, the checkpoints left out."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in output.iterdir() if path.is_file()}
