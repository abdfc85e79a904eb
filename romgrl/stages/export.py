"""Export: the trained student as files that run where there is no romgrl, and no torch."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from gymnasium.spaces import flatdim

from romgrl.algorithms.onnx_policy import onnx_policy
from romgrl.artifacts import read_manifest, write_bytes
from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.humanoid.command_schedules import CommandTable
from romgrl.humanoid.model_xml import model_xml
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.conditioned.asked_at_first import first_command, read_command_limits
from romgrl.stages.exporting import follow_commands, run_policy
from romgrl.stages.exporting.policy_json import COMMAND, Section, command_section, policy_description
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker

NO_MODEL = "no model.xml and no run_policy.py: the body is that of humanoid.xml, which may not be ours to pass on"


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write policy.onnx, policy.json and, where the humanoid is the project's own, model.xml and run_policy.py.

    Of a body that `humanoid.xml` describes nothing is written, not even the ranges of its controls: the graph ends at
    the action, and no script could run it. A conditioned student has its command as a second input, a section of
    policy.json, and follow_commands.py. Raises ArtifactError for a student of another humanoid.
    """
    own, follows = config.humanoid.xml is None, is_conditioned(config)
    env, asked = commanded(config, inputs["library"]) if follows else one_speed(config)
    with closing(env):
        policy = read_walker(inputs["student"], env)
        low, high = env.model.actuator_ctrlrange.T
        commands = sum(name.startswith(COMMAND) for name in env.observation_names)
        graph = onnx_policy(
            policy,
            observations=flatdim(env.single_observation_space) - commands,
            limits=(low, high) if own else None,
            commands=commands,
        )
        write_bytes(output / "policy.onnx", graph)
        if own:
            write_bytes(output / "model.xml", model_xml(config.humanoid, env.model).encode())
        described = json.dumps(policy_description(config, env, read_manifest(inputs["student"]), asked), indent=2)
        write_bytes(output / "policy.json", f"{described}\n".encode())
    if own:
        for script in (run_policy, follow_commands) if follows else (run_policy,):
            path = Path(str(script.__file__))
            write_bytes(output / path.name, path.read_bytes())
    log.message(copying(output) if own else NO_MODEL)


def one_speed(config: Config) -> tuple[PlanarHumanoidVectorEnv, Section]:
    """A humanoid that is to hold the speed, and what policy.json says of that."""
    return humanoid_env(config, num_envs=1), {"target_speed": {"value": config.speed, "unit": "m/s"}}


def commanded(config: Config, library: Path) -> tuple[PlanarHumanoidVectorEnv, Section]:
    """One that follows commands, and what policy.json says of these."""
    limits = read_command_limits(library, config)
    asked = first_command(limits, config)
    weights = {gait: float(gait == asked.gait) for gait in limits.speeds}
    env = humanoid_env(config, num_envs=1, commands=CommandTable.constant(asked.speed, weights, asked.style))
    return env, command_section(env, limits, asked)


def copying(output: Path) -> str:
    """How to let it walk: in a copy, as an artifact with another file in it would be taken for damaged."""
    finished = str(output.resolve()).removesuffix(".partial")
    return f"to let it walk: cp -r {shlex.quote(finished)} walker && python walker/run_policy.py"
