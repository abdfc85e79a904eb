"""The policy of a teacher, which fits the reduced-order model that it is to walk, or ArtifactError."""

from __future__ import annotations

import json
import math
from pathlib import Path

import torch
from gymnasium.spaces import flatdim

from romgrl.algorithms.policy_file import COLUMN_NAMES, NETWORK, check_tensors, require, require_names
from romgrl.algorithms.ppo_policy import PPOPolicy, load_ppo_policy
from romgrl.artifacts import load_tensors, save_tensors
from romgrl.config.schema import Config
from romgrl.config.teachers import CMAESTeacher, PPOTeacher
from romgrl.errors import ArtifactError
from romgrl.rom.gait_clocks import CLOCKS
from romgrl.rom.interface import RomVectorEnv
from romgrl.rom.phase_policy import COLUMNS, PhasePolicy, Span

CONTROLLER = "parameters"  # the tensor of a controller
DEGREES = range(1, 1 + int(CMAESTeacher.__dataclass_fields__["degree"].metadata["high"]))


def read_teacher(directory: Path, config: Config, env: RomVectorEnv) -> PPOPolicy | PhasePolicy:
    """The policy of the teacher for the reduced-order model that it is to walk."""
    path, teacher = directory / "policy.safetensors", config.teacher
    if not isinstance(teacher, PPOTeacher):
        return load_phase_policy(path)
    fits: dict[str, object] = {
        "input_size": flatdim(env.single_observation_space),
        "output_size": flatdim(env.single_action_space),
        "hidden_sizes": list(teacher.hidden_sizes),
        "activation": teacher.activation,
    }
    return load_ppo_policy(path, fits, env.observation_names)


def save_phase_policy(path: Path, policy: PhasePolicy) -> None:
    """Write the parameters of one controller, with what it reads."""
    spec: dict[str, object] = {"algorithm": "cmaes", COLUMN_NAMES: list(policy.observation_names)}
    spec |= {"gait": policy.gait, "spans": policy.spans}
    save_tensors(path, {CONTROLLER: torch.from_numpy(policy.parameters[0])}, {NETWORK: json.dumps(spec)})


def load_phase_policy(path: Path) -> PhasePolicy:
    """The controller from a file of `save_phase_policy`. Raises ArtifactError for any other."""
    tensors, metadata = load_tensors(path)
    try:
        spec = json.loads(metadata[NETWORK])
        algorithm, names = spec["algorithm"], spec[COLUMN_NAMES]
        size, spans = len(CLOCKS[spec["gait"]].mean), [spanned(*each) for each in spec["spans"]]
    except (KeyError, ValueError, TypeError) as error:
        raise ArtifactError(f"{path}: does not describe its controller; needed: metadata `{NETWORK}`") from error
    require(path, "algorithm", algorithm, "cmaes")
    require_names(path, names, PhasePolicy.observation_names)
    check_tensors(path, tensors, {CONTROLLER: (torch.float64, (size * (1 + len(spans)),))})
    if not bool(torch.isfinite(tensors[CONTROLLER]).all()):
        raise ArtifactError(f"{path}: {CONTROLLER} holds numbers that are not finite")
    return PhasePolicy(tensors[CONTROLLER].numpy(), spec["gait"], spans)


def spanned(column: str, low: float, high: float, power: int = 1) -> Span:
    """A span from its file. Raises ValueError for one that is none."""
    if column not in COLUMNS or not -math.inf < low < high < math.inf or power not in DEGREES:
        raise ValueError(f"{column} from {low} to {high}, power {power}")
    return Span(column, low, high, power)
