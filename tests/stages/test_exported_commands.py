"""The export of a student that follows commands: its second input, what it may be asked for, and its script."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import onnxruntime
import pytest

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, ConfigurationError
from romgrl.humanoid.command_schedules import CommandTable, DrawnCommands
from romgrl.humanoid.observation import observation_names
from romgrl.humanoid.skeleton import SMPL
from romgrl.humanoid.task import controls
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.provenance.stage_graph import plan
from romgrl.provenance.stage_keys import stage_key
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import export
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker
from tests.helpers.commanded import shipped_follower
from tests.helpers.configurations import with_value
from tests.helpers.exported import changed, disturbed_observations, equal_actions, refused, run_script, script_of

Follower = tuple[Config, dict[str, Path]]
STEPS = 300


@pytest.fixture(scope="module")
def script(exported_follower: Path) -> ModuleType:
    return script_of(exported_follower)


@pytest.fixture(scope="module")
def following(exported_follower: Path) -> ModuleType:
    return script_of(exported_follower, "follow_commands")


@pytest.fixture(scope="module")
def section(exported_follower: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((exported_follower / "policy.json").read_text(encoding="utf-8"))["command"]
    return found


def options(module: ModuleType, *arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    module.add_options(parser)
    return parser.parse_args(arguments)


def test_actions_of_1000_observations_with_their_commands(follower: Follower, exported_follower: Path) -> None:
    """Of commands that are drawn anew all the time, gaits, standing and styles among them."""
    config, inputs = follower
    drawn = DrawnCommands(("run", "walk"), (1.0, 4.0), (0.7, 1.4), hold_seconds=(0.1, 0.2), standing_share=0.2)
    env = humanoid_env(config, num_envs=8, commands=drawn)
    policy = read_walker(inputs["student"], env)
    observations = disturbed_observations(env, policy)
    session = onnxruntime.InferenceSession(exported_follower / "policy.onnx", providers=["CPUExecutionProvider"])
    body, command = np.split(observations, [358], axis=1)
    found, expected = (
        session.run(["action", "control"], {"observation": body, "command": command}),
        policy(observations),
    )
    equal_actions(found, expected, env)
    other = session.run(["action"], {"observation": body, "command": command[::-1].copy()})[0]
    assert np.abs(other - expected).max() > 0.01  # the command decides


def loop(env: PlanarHumanoidVectorEnv, inputs: dict[str, Path]) -> tuple[np.ndarray, np.ndarray]:
    """States and observations (STEPS + 1, ...) of romgrl's closed loop."""
    policy = read_walker(inputs["student"], env)
    observation, _ = env.reset(seed=3)
    states, seen = [env.states()[0]], [observation[0]]
    for _ in range(STEPS):
        observation, _, terminated, truncated, _ = env.step(policy(observation))
        assert not (terminated | truncated).any()
        states.append(env.states()[0])
        seen.append(observation[0])
    return np.array(states), np.array(seen)


SCHEDULES = {
    ("--commands", "0:1.0:walk,5:3.0:run"): ([0, 5], [1, 3], [[0, 1], [1, 0]], False),
    ("--commands", "0:2,2.5:3.5,8:2.25", "--ramp", "--gait", "run"): ([0, 2.5, 8], [2, 3.5, 2.25], [1, 0], True),
}


@pytest.mark.parametrize("arguments", SCHEDULES)
def test_a_closed_loop_takes_the_same_steps(
    follower: Follower, script: ModuleType, following: ModuleType, exported_follower: Path, arguments: tuple[str, ...]
) -> None:
    """With torch's actions all states are the same to the last bit; the graph's actions along the walk are within 1e-5
    of them, and its own walk begins as that one."""
    config, inputs = follower
    times, speeds, weights, ramp = SCHEDULES[arguments]
    env = humanoid_env(config, num_envs=1, commands=CommandTable(("run", "walk"), times, speeds, weights, ramp=ramp))
    expected, seen = loop(env, inputs)
    assert np.ptp(seen[:, 358]) == pytest.approx(np.ptp(speeds))  # the speed that is asked for
    policy = read_walker(inputs["student"], env)

    def walked(acting: Any) -> tuple[np.ndarray, np.ndarray]:
        """States of the script's walk, by the graph's actions or those of `acting`, and what the graph told."""
        walker, graph = script.load(exported_follower)
        walker.place(*np.split(expected[0], [walker.model.nq]))
        asked = following.read_commands(options(following, *arguments), walker.description["command"], 10.0)
        follow = following.FollowingPolicy(graph, asked, walker.description["control"]["rate"])
        told: list[np.ndarray] = []

        def act(observation: np.ndarray) -> np.ndarray:
            told.append(follow(observation))
            together = np.concatenate([observation, graph.command])
            np.testing.assert_array_equal(graph.command, seen[len(told) - 1, 358:])
            return told[-1] if acting is None else controls(env.model, acting(together[None])[0])

        steps = [np.concatenate([walker.data.qpos, walker.data.qvel]) for _ in script.walk(walker, act, STEPS)]
        return np.array([expected[0], *steps]), np.array(told)

    along, told = walked(policy)
    np.testing.assert_array_equal(along, expected)
    wanted = controls(env.model, policy(seen[:STEPS]))
    print(f"largest difference of a control along the walk: {np.abs(told - wanted).max():.2g}")
    assert np.abs(told - wanted).max() < 1e-5
    own, _ = walked(None)
    assert len(own) == STEPS + 1  # no fall
    assert np.abs(own - expected)[:4].max() < 1e-3
    assert own[-1, 0] - own[150, 0] == pytest.approx(expected[-1, 0] - expected[150, 0], rel=0.02)


def test_what_may_be_asked_for_is_described(exported_follower: Path, section: dict[str, Any]) -> None:
    assert section["input"] == "command"
    assert [(column["name"], column["unit"]) for column in section["columns"]] == [
        ("command.speed", "m/s"), ("command.run", "1"), ("command.walk", "1"), ("command.style", "1"),
    ]  # fmt: skip
    assert section["gaits"] == {"run": [2.0, 4.0], "walk": [1.0, 2.0]}
    assert (section["standing"], section["style"]) == ({"speed": 0.0, "trained": True}, [1.0, 1.0])
    assert section["begin"] == {"speed": 2.3, "gait": "run", "style": 1.0}
    described = json.loads((exported_follower / "policy.json").read_text(encoding="utf-8"))
    assert [column["name"] for column in described["observation"]] == [*observation_names(SMPL)]
    assert "target_speed" not in described
    assert described["made_by"]["student"]["key"] == "1" * 16


def test_a_speed_that_no_gait_has_is_refused(follower: Follower, tmp_path: Path) -> None:
    config, inputs = follower
    line = "speed: 7.0 is not allowed; allowed: 0 (to stand), run 2 to 4 m/s, walk 1 to 2 m/s, as the student was"
    with pytest.raises(ConfigurationError) as told:
        export.run(with_value(config, "speed", 7.0), inputs, tmp_path, SilentLog())
    assert str(told.value).startswith(line)
    assert not [*tmp_path.iterdir()]


def test_its_key_follows_the_speed_that_it_begins_with(follower: Follower) -> None:
    config, _ = follower
    assert plan(["export"], lambda stage: False, conditioned=True) == ["teacher", "library", "student", "export"]
    before = stage_key("export", config, {})
    assert stage_key("export", with_value(config, "speed", 3.0), {}) != before
    assert stage_key("export", with_value(config, "teacher.gait", "walk"), {}) != before
    assert stage_key("student", with_value(config, "speed", 3.0), {}) == stage_key("student", config, {})


def test_a_student_of_other_gaits_is_refused(follower: Follower, tmp_path: Path) -> None:
    config, inputs = follower
    hopper = shipped_follower(tmp_path / "student", config, gaits=("hop", "run"))
    with pytest.raises(ArtifactError, match=r"reads is command\.hop; needed: command\.run"):
        export.run(config, inputs | {"student": hopper}, tmp_path, SilentLog())


ASKED = {
    "": [(0, 2.3, "run")],
    "--speed 3": [(0, 3, "run")],
    "--speed 1.5": [(0, 1.5, "walk")],
    "--speed 0 --gait walk": [(0, 0, "walk")],
    "--gait walk": [(0, 2, "walk")],
    "--commands 0:1,2:2,4:3,5:2": [(0, 1, "walk"), (2, 2, "walk"), (4, 3, "run"), (5, 2, "run")],
    "--ramp": [(0, 2, "run"), (5, 4, "run"), (10, 2, "run")],
    "--ramp --gait walk": [(0, 1, "walk"), (5, 2, "walk"), (10, 1, "walk")],
}


@pytest.mark.parametrize("text", ASKED)
def test_what_options_ask_for(following: ModuleType, section: dict[str, Any], text: str) -> None:
    asked = following.read_commands(options(following, *text.split()), section, 10.0)
    assert [tuple(row) for row in asked.rows] == ASKED[text]
    last = asked.at(1e6)
    assert last.tolist() == [
        np.float32(ASKED[text][-1][1]), *(float(gait == ASKED[text][-1][2]) for gait in ("run", "walk")), 1.0,
    ]  # fmt: skip


BAD = {
    "--speed 5": "--speed: 5.0 is not allowed; allowed: 0 (to stand), run 2 to 4 m/s, walk 1 to 2 m/s",
    "--speed 3 --gait walk": "--speed: 3.0 is not allowed; allowed: 0 (to stand), walk 1 to 2 m/s",
    "--speed nan": "--speed: nan is not allowed; allowed: 0",
    "--gait hop": "--gait: hop is not allowed; allowed: run, walk",
    "--style 0.7": "--style: 0.7 is not allowed; allowed: 1",
    "--speed 2 --ramp": "argument --ramp: not allowed with argument --speed",
    "--commands 1:2": "--commands: 1:2 is not allowed; allowed: TIME:SPEED or",
    "--commands 0:2,0:3": "--commands: 0:3 is not allowed",
    "--commands 0:2,nan:3": "--commands: nan:3 is not allowed",
    "--commands 0": "--commands: 0 is not allowed",
    "--commands 0:2:hop": "--commands: hop is not allowed; allowed: run, walk",
    "--commands 0:2,1:9": "--commands: 9.0 is not allowed; allowed: 0 (to stand), run",
    "--commands 0:1,5:3 --ramp": "--commands: 0:1,5:3 is not allowed; allowed: with --ramp one gait, and no standing",
    "--commands 0:0:run,5:3 --ramp": "--commands: 0:0:run,5:3 is not allowed; allowed: with --ramp one gait",
}


@pytest.mark.parametrize("text", BAD)
def test_what_it_was_not_trained_for_is_refused(following: ModuleType, section: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError) as told:  # noqa: PT011 - the line is compared
        following.read_commands(options(following, *text.split()), section, 10.0)
    assert str(told.value).startswith(BAD[text])
    assert "\n" not in str(told.value)


def test_the_script_follows_and_leaves_nothing_behind(exported_follower: Path) -> None:
    before = {*exported_follower.iterdir()}
    done = run_script(exported_follower, "--seconds", "2", "--commands", "0:2,1:3")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("(asked for: 3.00 m/s)\n")
    assert {*exported_follower.iterdir()} == before
    done = run_script(exported_follower, "--speed", "9")
    assert (done.returncode, done.stdout) == (2, "")
    assert "--speed: 9.0 is not allowed; allowed: 0 (to stand), run 2 to 4 m/s" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("gaits", {"run": [2.0]}, "command.gaits is"),
        ("gaits", {}, "command.gaits is {}, not ranges"),
        ("columns", [{}], "takes 4 columns of a command; policy.json has 1"),
        ("style", None, "command.style is null, not two numbers"),
    ],
)
def test_a_broken_section_is_named(
    script: ModuleType, exported_follower: Path, tmp_path: Path, name: str, value: Any, told: str
) -> None:
    copied = Path(shutil.copytree(exported_follower, tmp_path / "copy"))
    changed(copied / "policy.json", lambda content: content["command"].__setitem__(name, value))
    with pytest.raises(script.BadFileError, match=r"needed: the files of one export") as caught:
        script.load(copied)
    assert told in str(caught.value)


def test_files_of_two_exports_are_refused(exported: Path, exported_follower: Path, tmp_path: Path) -> None:
    copied = Path(shutil.copytree(exported_follower, tmp_path / "copy"))
    (copied / "follow_commands.py").unlink()
    assert refused(run_script(copied)).startswith(f"{copied / 'follow_commands.py'}: no such file; needed: ")
    other = Path(shutil.copytree(exported, tmp_path / "other"))
    shutil.copy(exported_follower / "follow_commands.py", other)
    assert refused(run_script(other)).startswith(f"{other / 'follow_commands.py'}: of another export; needed: ")
