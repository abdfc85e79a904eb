"""Where the student that ships lies, how the script of an export is run, and how its actions are compared."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from romgrl.humanoid.task import controls
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.provenance.shipped import PLACE

SHIPPED = PLACE / "student"


def script_of(exported: Path, name: str = "run_policy") -> ModuleType:
    """A script as it lies in the artifact."""
    spec = importlib.util.spec_from_file_location(f"exported_{name}", exported / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def disturbed_observations(env: PlanarHumanoidVectorEnv, policy: Callable[[Any], Any]) -> Any:
    """1,000 of 8 walkers whose actions are disturbed all the time, so that they see more than their gait."""
    generator, (observation, _), seen = np.random.default_rng(0), env.reset(seed=0), []
    for _ in range(125):
        seen.append(observation)
        noise = generator.normal(0.0, 0.3, env.action_space.shape)
        observation, *_ = env.step((policy(observation) + noise).astype(np.float32))
    return np.concatenate(seen)


def equal_actions(found: Any, expected: Any, env: PlanarHumanoidVectorEnv) -> None:
    """Assert that actions and controls of a graph are those of torch for 1,000 observations."""
    action, control = found
    assert action.shape == (1000, 21)
    assert expected.std(axis=0).min() > 0.01
    print(f"largest difference of an action: {np.abs(action - expected).max():.2g}")
    assert np.abs(action - expected).max() < 1e-5
    assert np.abs(control - controls(env.model, expected)).max() < 1e-5


def run_script(directory: Path, *arguments: str, without: str = "") -> subprocess.CompletedProcess[str]:
    """Run it in its directory, where romgrl, torch and what they need cannot be imported."""
    blocked = ["romgrl", "torch", "gymnasium", "onnx", "hydra", "scipy", *filter(None, [without])]
    run = "runpy.run_path('run_policy.py', run_name='__main__')"
    code = f"import sys, runpy; sys.modules.update(dict.fromkeys({blocked})); sys.argv[0] = 'run_policy.py'; {run}"
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False, encoding="utf-8")


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """The one line that it ended with."""
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    return line


def changed(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change a JSON file."""
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")
