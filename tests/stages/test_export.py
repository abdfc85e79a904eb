"""What stage=export writes of the student that ships: a policy, a model and a description that are romgrl's own."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import onnx
import onnxruntime
import pytest

from romgrl.artifacts import open_artifact
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.humanoid import model_xml as xml_of_model
from romgrl.humanoid.model import configured, identity
from romgrl.humanoid.observation import observation_names
from romgrl.humanoid.own_body import human_spec
from romgrl.humanoid.skeleton import SMPL
from romgrl.pipeline import run as pipeline
from romgrl.provenance.stage_keys import body_digests, stage_settings
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import export
from romgrl.stages.exporting.policy_json import actuator
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.walker_policy import read_walker
from tests.conftest import Composer
from tests.helpers.exported import SHIPPED, disturbed_observations, equal_actions
from tests.helpers.walkers import write_walker

REFUSED = "model.xml: MuJoCo .* reads another model than it wrote"
FILES = {"model.xml", "policy.json", "policy.onnx", "run_policy.py"}


@pytest.fixture(scope="module")
def config(compose_config: Composer) -> Config:
    return compose_config("student=pretrained", "threads=1")


@pytest.fixture(scope="module")
def described(exported: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((exported / "policy.json").read_text(encoding="utf-8"))
    return found


def test_actions_of_1000_observations(config: Config, exported: Path) -> None:
    """Of walkers that are disturbed all the time, so that they see more than their gait."""
    env = humanoid_env(config, num_envs=8)
    policy = read_walker(SHIPPED, env)
    observations = disturbed_observations(env, policy)
    session = onnxruntime.InferenceSession(exported / "policy.onnx", providers=["CPUExecutionProvider"])
    found = session.run(["action", "control"], {"observation": observations})
    equal_actions(found, policy(observations), env)


def test_the_model_is_the_same_to_the_last_bit(config: Config, exported: Path) -> None:
    written, model = mujoco.MjModel.from_xml_path(str(exported / "model.xml")), configured(config.humanoid)
    compared = 0
    for one, other in ((written, model), (written.opt, model.opt)):
        for name in (name for name in dir(other) if not name.startswith("_") and name != "signature"):
            value = getattr(other, name)
            if isinstance(value, np.ndarray | int | float):
                assert np.array_equal(getattr(one, name), value), name
                compared += 1
    assert compared > 300


def test_a_model_that_would_be_another_one_is_refused(config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml_of_model, "DOUBLE_DIGITS", 6)
    with pytest.raises(ArtifactError, match=REFUSED):
        xml_of_model.model_xml(config.humanoid, configured(config.humanoid))


def test_one_bit_is_another_model(config: Config) -> None:
    """The last bit of a number, of a kind that no digest tells apart."""
    model = configured(config.humanoid)
    model.body_mass[3] = np.nextafter(model.body_mass[3], 0.0)
    with pytest.raises(ArtifactError, match=rf"{REFUSED}: body_mass differs$"):
        xml_of_model.model_xml(config.humanoid, model)


@pytest.mark.parametrize("missing", ["function", "library"])
def test_a_mujoco_that_cannot_write_all_digits_is_told(
    config: Config, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, missing: str
) -> None:
    if missing == "function":
        monkeypatch.setattr(xml_of_model.ctypes, "CDLL", lambda path: object())
    else:
        monkeypatch.setattr(xml_of_model.mujoco, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(ArtifactError, match=REFUSED):
        xml_of_model.model_xml(config.humanoid, configured(config.humanoid))


def test_what_the_policy_sees_and_does_is_described(config: Config, described: dict[str, Any]) -> None:
    model = configured(config.humanoid)
    assert [column["name"] for column in described["observation"]] == [*observation_names(SMPL)]
    units = {column["name"].split(".")[1]: column["unit"] for column in described["observation"]}
    assert units["height"] == units["position"] == "m"
    assert (units["axis_x"], units["velocity"], units["angular_velocity"]) == ("1", "m/s", "rad/s")
    assert [action["joint"] for action in described["actions"]] == [*SMPL.hinges]
    assert np.array([action["control"] for action in described["actions"]]) == pytest.approx(model.actuator_ctrlrange)
    assert described["control"] == {"rate": 30.0, "substeps": 16, "timestep": 1 / 480}
    assert described["target_speed"] == {"value": 4.0, "unit": "m/s"}
    student = open_artifact(SHIPPED)
    assert described["made_by"]["student"]["sha256"] == student.digest
    assert described["made_by"]["student"]["key"] == student.key
    assert described["made_by"].keys() == {"romgrl", "mujoco", "onnx", "student"}
    assert (described["made_by"]["mujoco"], described["made_by"]["onnx"]) == (mujoco.__version__, onnx.__version__)


@pytest.mark.parametrize("actuation", ["servo", "torque"])
def test_gains_and_limits_give_the_torques(config: Config, actuation: str) -> None:
    """Torques of random controls and states, beside MuJoCo's."""
    model = configured(replace(config.humanoid, actuation=actuation))
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    kinds, limited = set(), 0
    for _ in range(50):
        data.qpos[3:] = generator.uniform(*model.jnt_range[3:].T)
        data.qvel[3:] = generator.normal(0.0, 4.0, model.nu)
        data.ctrl[:] = generator.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_forward(model, data)
        for index in range(model.nu):
            entry, (angle, rate) = actuator(model, index), (data.qpos[3 + index], data.qvel[3 + index])
            torque = entry["kp"] * (data.ctrl[index] - (0.0 if entry["kind"] == "motor" else angle))
            torque -= entry["kd"] * rate
            if entry["kind"] == "dc_servo":
                stall, braking = entry["stall_torque"], entry["stall_torque"] / entry["no_load_speed"] * rate
                torque = np.clip(torque, -stall - braking, stall - braking)
            limited += not entry["torque"][0] < torque < entry["torque"][1]
            torque = np.clip(torque, *entry["torque"])
            assert data.actuator_force[index] == pytest.approx(torque, rel=1e-9, abs=1e-9), (entry["joint"], index)
            kinds.add(entry["kind"])
    assert kinds == ({"servo", "dc_servo"} if actuation == "servo" else {"motor"})
    assert limited > 0


def test_a_job_publishes_it_and_finds_it_again(
    compose_config: Composer, tmp_path: Path, exported: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs = f"paths.outputs={tmp_path}/outputs"
    job = compose_config("student=pretrained", "stage=export", "threads=1", "tracking=none", outputs)
    made = pipeline.run(job)["export"]
    assert f"to let it walk: cp -r {made} walker && python walker/run_policy.py\n" in capsys.readouterr().out
    manifest = open_artifact(made, stage="export")
    assert manifest.files.keys() == FILES
    assert [*manifest.inputs] == ["student"]
    for name in FILES - {"policy.json"}:  # which names the artifact of the student
        assert (made / name).read_bytes() == (exported / name).read_bytes()
    before = (made / "manifest.json").stat().st_mtime_ns
    assert pipeline.run(job)["export"] == made
    assert (made / "manifest.json").stat().st_mtime_ns == before


def own_body(config: Config, path: Path) -> Config:
    """The same with our own body as the file of a user, in two files."""
    spec = human_spec(height=config.humanoid.height, mass=config.humanoid.mass)
    spec.compile()
    inner = spec.to_xml().partition(">")[2].rpartition("</mujoco>")[0]
    path.with_name("inner.xml").write_text(f"<mujoco>{inner}</mujoco>", encoding="utf-8")
    path.write_text('<mujoco><include file="inner.xml"/></mujoco>', encoding="utf-8")
    return replace(config, humanoid=replace(config.humanoid, xml=str(path)))


def exported_of(theirs: Config, place: Path) -> Path:
    """The export of a walker of that body."""
    (place / "student").mkdir(parents=True)
    write_walker(place / "student" / "policy.safetensors", humanoid=identity(configured(theirs.humanoid)))
    (place / "student" / "manifest.json").write_bytes((SHIPPED / "manifest.json").read_bytes())
    (place / "output").mkdir()
    export.run(theirs, {"student": place / "student"}, place / "output", SilentLog())
    return place / "output"


def test_a_model_is_known_by_what_the_key_has_of_it(config: Config, tmp_path: Path) -> None:
    """So a policy.json that is found again is not of another model; what it includes counts, a comment does not."""
    theirs, described = own_body(config, tmp_path / "body.xml"), []
    outer, inner = (tmp_path / name for name in ("body.xml", "inner.xml"))
    text = inner.read_text(encoding="utf-8")
    heavier = re.sub(r'mass="([0-9.]+)"', lambda found: f'mass="{1.01 * float(found[1])}"', text)
    assert heavier != text
    for number, (path, content) in enumerate(
        ((inner, text), (outer, f"<!-- -->{outer.read_text(encoding='utf-8')}"), (inner, heavier))
    ):
        path.write_text(content, encoding="utf-8")
        body_digests.cache_clear()
        key = stage_settings("export", theirs)["humanoid.xml"]
        output = exported_of(theirs, tmp_path / str(number))
        described.append((output / "policy.json").read_bytes())
        assert f"sha256:{json.loads(described[-1])['model']['needed']['compiled_sha256']}" == key
    assert described[0] == described[1] != described[2]
    body_digests.cache_clear()


def test_nothing_is_copied_of_a_file_of_the_user(config: Config, tmp_path: Path) -> None:
    """Of the body of a file there are neither model nor numbers, and no script, which could not run."""
    output = exported_of(own_body(config, tmp_path / "body.xml"), tmp_path)
    assert {path.name for path in output.iterdir()} == {"policy.json", "policy.onnx"}
    found = json.loads((output / "policy.json").read_text(encoding="utf-8"))
    assert found["actions"] == [{"joint": joint} for joint in SMPL.hinges]
    assert not {"start", "fall"} & found.keys()
    session = onnxruntime.InferenceSession(output / "policy.onnx", providers=["CPUExecutionProvider"])
    assert [output.name for output in session.get_outputs()] == ["action"]
