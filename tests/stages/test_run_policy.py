"""The script of an export walks as romgrl's own environment does, and needs nothing of romgrl."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from romgrl.config.schema import Config
from romgrl.humanoid.task import controls
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker
from tests.conftest import Composer
from tests.helpers.exported import SHIPPED, exported_student

STEPS = 300
Controller = Callable[[np.ndarray], np.ndarray]


@pytest.fixture(scope="module")
def config(compose_config: Composer) -> Config:
    return compose_config("student=pretrained", "threads=1")


@pytest.fixture(scope="module")
def exported(config: Config, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported_student(config, tmp_path_factory.mktemp("export"))


@pytest.fixture(scope="module")
def script(exported: Path) -> ModuleType:
    """The script as it lies in the artifact."""
    spec = importlib.util.spec_from_file_location("exported_run_policy", exported / "run_policy.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def own_states(env: PlanarHumanoidVectorEnv, seed: int) -> np.ndarray:
    """States (STEPS + 1, nq + nv) of romgrl's closed loop from a reset, none of them fallen."""
    policy = read_walker(SHIPPED, env)
    observation, _ = env.reset(seed=seed)
    states = [env.states()[0]]
    for _ in range(STEPS):
        observation, _, terminated, _, _ = env.step(policy(observation))
        assert not terminated.any()
        states.append(env.states()[0])
    return np.array(states)


def states_of_script(script: ModuleType, exported: Path, policy: Controller | None, start: np.ndarray) -> np.ndarray:
    """The same of the script's functions, with its own policy or another one; up to a fall."""
    walker, graph = script.load(exported)
    walker.place(*np.split(start, [walker.model.nq]))
    states = [start]
    for _ in script.walk(walker, policy or graph, STEPS):
        states.append(np.concatenate([walker.data.qpos, walker.data.qvel]))
    return np.array(states)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_observation_and_physics_are_romgrls_to_the_last_bit(
    config: Config, script: ModuleType, exported: Path, seed: int
) -> None:
    """The closed loop with the policy as torch computes it: what it sees, and what follows from it, is the same."""
    env = humanoid_env(config, num_envs=1, episode_steps=STEPS + 1)
    policy, expected = read_walker(SHIPPED, env), own_states(env, seed)
    found = states_of_script(script, exported, lambda seen: controls(env.model, policy(seen[None])[0]), expected[0])
    assert np.ptp(expected[:, 0]) > 30.0  # it runs, m
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_closed_loop_of_the_graph_stays_with_romgrls(
    config: Config, script: ModuleType, exported: Path, seed: int
) -> None:
    """onnxruntime adds up in another order than torch, and touchdowns enlarge the last bit; the gait is the same."""
    env = humanoid_env(config, num_envs=1, episode_steps=STEPS + 1)
    expected = own_states(env, seed)
    found = states_of_script(script, exported, None, expected[0])
    assert len(found) == STEPS + 1  # no fall
    assert np.abs(found - expected)[:4].max() < 1e-3
    assert found[-1, 0] - found[150, 0] == pytest.approx(expected[-1, 0] - expected[150, 0], rel=0.02)


def test_it_begins_where_romgrl_does_and_falls_where_romgrl_does(
    config: Config, script: ModuleType, exported: Path
) -> None:
    env = humanoid_env(config, num_envs=1)
    walker, _ = script.load(exported)
    observation, _ = env.reset(seed=config.seed + 50_000)
    np.testing.assert_array_equal(np.concatenate([walker.data.qpos, walker.data.qvel]), env.states()[0])
    np.testing.assert_allclose(walker.observe(), observation[0], rtol=2e-7, atol=1e-12)
    generator, agreed = np.random.default_rng(0), {True: 0, False: 0}
    for _ in range(300):
        state = np.concatenate([walker.data.qpos * 0.0, walker.data.qvel * 0.0])
        state[:3] = generator.normal([0.0, 0.85, 0.0], [1.0, 0.2, 0.5])
        env.set_states(state[None])
        fallen = bool(env.task.fallen(env._observer(env._qpos, env._qvel)[1])[0])
        walker.place(*np.split(state, [walker.model.nq]))
        assert walker.has_fallen() == fallen
        agreed[fallen] += 1
    assert min(agreed.values()) > 30


def test_commands_are_columns_behind_those_of_the_body(script: ModuleType, exported: Path) -> None:
    walker, _ = script.load(exported)
    description = walker.description | {"commands": [{"name": "speed", "unit": "m/s", "value": 2.5}]}
    conditioned = script.Walker(walker.model, description)
    np.testing.assert_array_equal(conditioned.observe(), [*walker.observe(), 2.5])


def run_script(directory: Path, *arguments: str, without: str = "") -> subprocess.CompletedProcess[str]:
    """Run it where romgrl, torch and what they need cannot be imported."""
    blocked = ["romgrl", "torch", "gymnasium", "onnx", "hydra", "scipy", *filter(None, [without])]
    run = f"runpy.run_path({str(directory / 'run_policy.py')!r}, run_name='__main__')"
    code = f"import sys, runpy; sys.modules.update(dict.fromkeys({blocked})); sys.argv[0] = 'run_policy.py'; {run}"
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, encoding="utf-8")


def test_it_needs_no_romgrl(exported: Path) -> None:
    done = run_script(exported, "--seconds", "8")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("8.0 s, no fall; ")
    speed = float(done.stdout.split("; ")[1].split()[0])
    assert speed == pytest.approx(4.0, abs=0.2)


def test_a_walker_that_falls_is_told(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported, tmp_path / "copy")
    described = json.loads((tmp_path / "copy" / "policy.json").read_text(encoding="utf-8"))
    described["start"]["qpos"][2] = 0.7  # leans forward, rad
    (tmp_path / "copy" / "policy.json").write_text(json.dumps(described), encoding="utf-8")
    assert ", then it fell; " in run_script(tmp_path / "copy").stdout


def test_what_is_missing_is_told_on_one_line(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported, tmp_path / "copy")
    (tmp_path / "copy" / "model.xml").unlink()
    for done, told in (
        (run_script(tmp_path / "copy"), "model.xml: no such file"),
        (run_script(exported, without="onnxruntime"), "onnxruntime"),
        (run_script(exported, "--seconds", "0"), "--seconds: 0.0 is not allowed; allowed: 0.1 to 1e6"),
    ):
        assert done.returncode != 0
        assert told in done.stderr.splitlines()[-1]
        assert "Traceback" not in done.stderr
