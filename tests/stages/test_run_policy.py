"""The script of an export walks as romgrl's own environment does, and needs nothing of romgrl."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from functools import reduce
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import onnx
import pytest

from romgrl.config.schema import Config
from romgrl.humanoid.task import controls
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker
from tests.conftest import Composer
from tests.helpers.exported import SHIPPED, changed, refused, run_script, script_of

STEPS = 300
Controller = Callable[[np.ndarray], np.ndarray]


@pytest.fixture(scope="module")
def config(compose_config: Composer) -> Config:
    return compose_config("student=pretrained", "threads=1")


@pytest.fixture(scope="module")
def script(exported: Path) -> ModuleType:
    return script_of(exported)


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


@pytest.fixture
def copied(exported: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(exported, tmp_path / "copy"))


def test_it_needs_no_romgrl(exported: Path) -> None:
    done = run_script(exported, "--seconds", "8")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("8.0 s, no fall; ")
    speed = float(done.stdout.split("; ")[1].split()[0])
    assert speed == pytest.approx(4.0, abs=0.2)


def test_a_walker_that_falls_is_told(copied: Path) -> None:
    changed(copied / "policy.json", lambda content: content["start"]["qpos"].__setitem__(2, 0.7))  # leans forward, rad
    done = run_script(copied)
    assert done.returncode == 0
    assert ", then it fell; " in done.stdout


def test_a_simulation_that_diverges_is_a_fall_and_leaves_no_file(copied: Path) -> None:
    changed(copied / "policy.json", lambda content: content["start"]["qvel"].__setitem__(5, 9e8))  # rad/s
    before = {*copied.iterdir()}
    done = run_script(copied)
    assert (done.returncode, done.stderr) == (0, "")
    assert ", then it fell; " in done.stdout
    assert {*copied.iterdir()} == before


GARBLED: dict[str, tuple[str, bytes, str]] = {
    "cut JSON": ("policy.json", b"{", "Expecting property name"),
    "empty object": ("policy.json", b"{}", "not the description of an export of format 1"),
    "list": ("policy.json", b"[]", "not the description of an export of format 1"),
    "other format": ("policy.json", b'{"format": 2}', "not the description of an export of format 1"),
    "no UTF-8": ("policy.json", b"\xff\xfe", "codec can't decode"),
    "deep": ("policy.json", b"[" * 10**5, "recursion"),
    "empty graph": ("policy.onnx", b"", ""),
    "no graph": ("policy.onnx", b"garbled", ""),
    "cut MJCF": ("model.xml", b"<mujoco>", "XML"),
    "no UTF-8 in MJCF": ("model.xml", b"\xff\xfe", ""),
    "other model": ("model.xml", b"<mujoco/>", "0 qpos, not 24 as policy.json says"),
}


@pytest.mark.parametrize("case", GARBLED)
def test_a_garbled_file_is_named(copied: Path, case: str) -> None:
    name, content, told = GARBLED[case]
    (copied / name).write_bytes(content)
    line = refused(run_script(copied))
    assert line.startswith(f"{copied / name}: ")
    assert told in line
    assert line.endswith("; needed: the files of one export, side by side")


WRONG: dict[str, tuple[str, Any, str]] = {
    "NaN": ("control.rate", float("nan"), "control.rate is NaN, not a number above 0"),
    "text": ("control.substeps", "16", 'control.substeps is "16", not a whole number above 0'),
    "truth": ("control.substeps", True, "control.substeps is true, not a whole number above 0"),
    "rate": ("control.rate", 60.0, "a timestep of 0.00208333 s, not that of policy.json's control"),
    "number": ("body", 3, "body.forward_axis is null, not 0, 1 or 2"),
    "axis": ("body.forward_axis", 3, "body.forward_axis is 3, not 0, 1 or 2"),
    "body": ("body.head", "Nobody", "Invalid name 'Nobody'"),
    "positions": ("start.qpos", [0.0, 0.0], "24 qpos, not 2 as policy.json says"),
    "velocities": ("start.qvel", [], "start.qvel is [], not numbers"),
    "limit": ("fall.trunk_lean", None, "fall.trunk_lean is null, not a number"),
    "actions": ("actions", [{}], "21 actuators, not 1 as policy.json says"),
    "columns": ("observation", [{}], "columns; policy.json has 1, the body "),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_description_that_does_not_fit_is_named(script: ModuleType, copied: Path, case: str) -> None:
    path, value, told = WRONG[case]
    *sections, name = path.split(".")

    def change(content: dict[str, Any]) -> None:
        reduce(dict.__getitem__, sections, content)[name] = value

    changed(copied / "policy.json", change)
    with pytest.raises(script.BadFileError) as caught:
        script.load(copied)
    assert told in str(caught.value)


def test_a_graph_of_another_body_is_refused(script: ModuleType, copied: Path) -> None:
    graph = onnx.load(copied / "policy.onnx")
    graph.graph.input[0].type.tensor_type.shape.dim[1].dim_value = 400
    onnx.save(graph, copied / "policy.onnx")
    with pytest.raises(script.BadFileError, match=r"policy.onnx: takes 400 columns; policy.json has \d+, the body \d+"):
        script.load(copied)


def test_a_graph_without_controls_is_refused(script: ModuleType, copied: Path) -> None:
    graph = onnx.load(copied / "policy.onnx")
    del graph.graph.output[1]
    onnx.save(graph, copied / "policy.onnx")
    with pytest.raises(script.BadFileError, match=r"policy.onnx: .*control"):
        script.load(copied)


@pytest.mark.parametrize("name", ["policy.json", "policy.onnx", "model.xml"])
def test_a_missing_file_is_named(copied: Path, name: str) -> None:
    (copied / name).unlink()
    told = f"{copied / name}: no such file; needed: the files of one export, side by side"
    assert refused(run_script(copied)) == told


@pytest.mark.parametrize("package", ["numpy", "mujoco", "onnxruntime"])
def test_a_missing_package_is_named(exported: Path, package: str) -> None:
    line = refused(run_script(exported, without=package))
    assert package in line.split(";")[0]
    assert line.endswith("; needed: pip install numpy mujoco onnxruntime")


def test_a_bad_length_is_refused(exported: Path) -> None:
    done = run_script(exported, "--seconds", "0")
    assert done.returncode == 2
    assert "--seconds: 0.0 is not allowed; allowed: 0.1 to 1e6" in done.stderr.splitlines()[-1]


def test_ctrl_c_tells_what_was_walked(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any) -> Iterator[float]:
        yield from np.arange(60) * 0.1
        raise KeyboardInterrupt

    monkeypatch.setattr(script, "walk", interrupted)
    monkeypatch.setattr(script.mujoco, "set_mju_user_warning", lambda handler: None)
    monkeypatch.setattr(sys, "argv", ["run_policy.py"])
    with pytest.raises(SystemExit) as ended:
        script.main()
    assert ended.value.code == 130
    assert capsys.readouterr().out == "2.0 s, interrupted; 3.00 m/s over the second half (asked for: 4.00 m/s)\n"


def test_no_display_is_told(exported: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform.startswith("linux"):
        assert refused(run_script(exported, "--viewer")) == "--viewer: no display that opens"
