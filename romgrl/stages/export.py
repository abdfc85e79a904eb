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
from romgrl.config.schema import Config
from romgrl.humanoid.model_xml import model_xml
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.exporting import run_policy
from romgrl.stages.exporting.policy_json import policy_description
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker

NO_MODEL = "no model.xml and no run_policy.py: the body is that of humanoid.xml, which may not be ours to pass on"


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write policy.onnx, policy.json and, where the humanoid is the project's own, model.xml and run_policy.py.

    Of a body that `humanoid.xml` describes nothing is written, not even the ranges of its controls: the graph ends at
    the action, and no script could run it. Raises ArtifactError for a student of another humanoid.
    """
    own = config.humanoid.xml is None
    with closing(humanoid_env(config, num_envs=1)) as env:
        policy = read_walker(inputs["student"], env)
        low, high = env.model.actuator_ctrlrange.T
        graph = onnx_policy(
            policy, observations=flatdim(env.single_observation_space), limits=(low, high) if own else None
        )
        write_bytes(output / "policy.onnx", graph)
        if own:
            write_bytes(output / "model.xml", model_xml(config.humanoid, env.model).encode())
        described = json.dumps(policy_description(config, env, read_manifest(inputs["student"])), indent=2)
        write_bytes(output / "policy.json", f"{described}\n".encode())
    if own:
        write_bytes(output / "run_policy.py", Path(run_policy.__file__).read_bytes())
    log.message(copying(output) if own else NO_MODEL)


def copying(output: Path) -> str:
    """How to let it walk: in a copy, as an artifact with another file in it would be taken for damaged."""
    finished = str(output.resolve()).removesuffix(".partial")
    return f"to let it walk: cp -r {shlex.quote(finished)} walker && python walker/run_policy.py"
