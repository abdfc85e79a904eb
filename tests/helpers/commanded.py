"""A small library of runs and walks, and a conditioned student that trains on it in seconds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import torch

from romgrl.algorithms.policy_file import COLUMN_NAMES, NETWORK
from romgrl.algorithms.sac import MIRRORS
from romgrl.artifacts import load_tensors, save_tensors, write_manifest
from romgrl.config.schema import Config
from romgrl.humanoid.skeleton import SMPL
from romgrl.provenance.stage_keys import stage_settings
from romgrl.report.finished_library import RECORDED
from tests.conftest import Composer
from tests.helpers.exported import SHIPPED
from tests.helpers.synthetic_library import STEPS, synthetic_library, write_library

CONDITIONED = (
    "threads=1",
    "student=conditioned",
    "stage=student",
    f"reference.steps={STEPS}",
    "reference.episodes=2",
    "student.hidden_sizes=[32,32]",
    "student.num_envs=8",
    "student.total_steps=1600",
    "student.learning_starts=400",
    "student.batch_size=32",
    "student.buffer_size=960",
    "student.updates_per_step=0.1",
    "student.check_steps=800",
    "student.hold_seconds=[0.1,0.4]",
    "discriminator.batch_size=32",
    "discriminator.hidden_sizes=[32,16]",
    "discriminator.recent_steps=400",
    "evaluation.window=100",
    "humanoid.episode_steps=40",
)


def commanded(compose: Composer, *overrides: str) -> Config:
    """A training of 1,600 steps."""
    return compose(*CONDITIONED, *overrides)


def small_library(directory: Path) -> Path:
    """Runs at 2, 3 and 4 m/s and walks at 1 and 2 m/s, one run of which fell, and runs of stiff legs."""
    table, arrays = synthetic_library((1.0, 2.0, 3.0, 4.0), (1.0, 1.4), gaits=("run", "walk"))
    speed, walks = table.speed_m_per_s, table.gait == "walk"
    rows = table.index[(walks & (speed <= 2.0)) | (~walks & (speed >= 2.0))]
    kept = {name: values[rows] if name in RECORDED else values for name, values in arrays.items()}
    return Path(write_library(directory, table.loc[rows].reset_index(drop=True), kept))


def shipped_follower(directory: Path, config: Config, gaits: Sequence[str] = ("run", "walk")) -> Path:
    """The student that ships, as one that sees commands: they move its actions a little, and it runs on."""
    directory.mkdir(parents=True)
    tensors, metadata = load_tensors(SHIPPED / "policy.safetensors")
    network, count = json.loads(metadata[NETWORK]), len(gaits) + 2
    names = ["command.speed", *(f"command.{gait}" for gait in gaits), "command.style"]
    network |= {"inputs": network["inputs"] + count, COLUMN_NAMES: [*network[COLUMN_NAMES], *names]}
    size = SMPL.observation_size
    places = torch.arange(len(tensors["columns"]), len(tensors["columns"]) + count)
    more = {
        "columns": size + torch.arange(count),
        "observation_mean": torch.linspace(0.5, 1.5, count),
        "observation_scale": torch.linspace(0.5, 2.0, count),
        MIRRORS[0]: places,
        MIRRORS[1]: torch.ones(count),
    }
    tensors |= {name: torch.cat([tensors[name], values.to(tensors[name].dtype)]) for name, values in more.items()}
    first = tensors["policy.weight_0"]
    small = 0.02 * torch.randn((1, count, first.shape[2]), generator=torch.Generator().manual_seed(0))
    tensors["policy.weight_0"] = torch.cat([first, small], dim=1)
    save_tensors(directory / "policy.safetensors", tensors, {NETWORK: json.dumps(network)})
    facts = {"inputs": {}, "versions": {}, "revision": None, "dirty": None, "seed": 0, "wall_time": 1.0}
    settings = json.loads(json.dumps(stage_settings("student", config)))
    write_manifest(directory, stage="student", key="1" * 16, config=settings, **facts)
    return directory
