"""A body of other names, another number of bodies, other axes and no arms: docs/examples/other_body.py."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

from romgrl.config.schema import Config
from romgrl.errors import ConfigurationError
from romgrl.gait.features import MIRROR
from romgrl.humanoid.changed_body import scaled
from romgrl.humanoid.env import PlanarHumanoidEnv
from romgrl.humanoid.loads import replay
from romgrl.humanoid.model import build, dimensions, fingerprint
from romgrl.humanoid.observation import observation_names, observe
from romgrl.humanoid.planar_observer import GAIT_FEATURES, HEAD_HEIGHT, TRUNK_LEAN, PlanarObserver
from romgrl.humanoid.reference_states import ReferenceStates
from romgrl.humanoid.rendering import RenderingError, SideCamera
from romgrl.humanoid.skeleton import SKELETON_TEXT, SKELETONS, SMPL, skeleton_of
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from romgrl.report import film
from romgrl.report.page import scene
from tests.helpers.examples import example

LEGS = ("thigh_left", "shin_left", "foot_left", "thigh_right", "shin_right", "foot_right")
STANDING = 0.9  # height of the pelvis, m


@pytest.fixture(scope="module")
def body() -> Iterator[ModuleType]:
    before = dict(SKELETONS)
    yield example("other_body")
    SKELETONS.clear()
    SKELETONS.update(before)


@pytest.fixture(scope="module")
def model(body: ModuleType) -> mujoco.MjModel:
    return build(xml=body.XML, skeleton=body.WALKER)


def moved(model: mujoco.MjModel, state: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.split(state, 2)
    mujoco.mj_forward(model, data)
    return data


def test_the_model_knows_its_skeleton(body: ModuleType, model: mujoco.MjModel) -> None:
    assert skeleton_of(model) is body.WALKER
    assert skeleton_of(scaled(model, mass=2.0)) is body.WALKER
    assert skeleton_of(build()) is SMPL
    assert body.WALKER.bodies == ("pelvis", *LEGS, "trunk", "head")
    assert body.WALKER.hinges == (*LEGS, "trunk")
    assert body.WALKER.feet == (frozenset({"foot_left"}), frozenset({"foot_right"}))
    assert body.WALKER.right == ("thigh_right", "shin_right", "foot_right", None, None)
    assert [model.joint(joint).name for joint in range(model.njnt)] == [
        "root_x",
        "root_z",
        "root_pitch",
        *LEGS,
        "trunk",
    ]
    assert fingerprint(model) != fingerprint(build())


def test_a_file_with_a_label_is_labelled_anew(body: ModuleType, tmp_path: Path) -> None:
    text = body.XML.read_text(encoding="utf-8")
    label = f'<custom><text name="{SKELETON_TEXT}" data="smpl"/></custom></mujoco>'
    (tmp_path / "labelled.xml").write_text(text.replace("</mujoco>", label), encoding="utf-8")
    assert skeleton_of(build(xml=tmp_path / "labelled.xml", skeleton=body.WALKER)) is body.WALKER


def test_dimensions(model: mujoco.MjModel) -> None:
    size = dimensions(model)
    assert size.mass == pytest.approx(60.0)
    assert size.leg_length == pytest.approx(0.82)
    assert (size.pelvis_height, size.head_height) == (pytest.approx(STANDING), pytest.approx(1.5))


def test_positive_angles_move_what_hangs_below_backward(model: mujoco.MjModel) -> None:
    state = np.zeros(20)
    state[3] = 0.5
    data = moved(model, state)
    assert data.body("foot_left").xpos[0] == pytest.approx(-0.82 * np.sin(0.5))
    assert data.body("foot_right").xpos[0] == pytest.approx(0.0)


@pytest.mark.parametrize("compact", [False, True])
def test_observer_equals_observe_and_columns_have_names(
    body: ModuleType, model: mujoco.MjModel, *, compact: bool
) -> None:
    env = PlanarHumanoidVectorEnv(model=model, num_envs=16, compact=compact)
    env.reset(seed=0)
    generator, names = np.random.default_rng(1), observation_names(body.WALKER)
    for _ in range(5):
        observation, *_ = env.step(generator.uniform(-1, 1, (16, 7)).astype(np.float32))
    assert env.single_observation_space.shape == (len(env.columns),) == (76 if compact else 133,)
    assert env.action_names == body.WALKER.hinges
    assert env.observation_names == tuple(names[column] for column in env.columns)
    for row, state in enumerate(env.states()):
        assert observation[row] == pytest.approx(observe(model, moved(model, state))[env.columns], rel=2e-7, abs=1e-12)


def test_each_name_is_of_its_number(body: ModuleType, model: mujoco.MjModel) -> None:
    """Facing backward too, where the heading frame is turned by half a turn."""
    for pitch, heading in ((0.3, 1.0), (2.8, -1.0)):
        state = np.random.default_rng(0).uniform(-0.5, 0.5, 20)
        state[2] = pitch
        data = moved(model, state)
        seen = dict(zip(observation_names(body.WALKER), observe(model, data), strict=True))
        foot, pelvis = data.body("foot_right"), data.body("pelvis")
        assert seen["pelvis.height"] == pelvis.xpos[2]
        assert seen["foot_right.position.x"] == pytest.approx(heading * (foot.xpos - pelvis.xpos)[0])
        assert seen["foot_right.position.z"] == pytest.approx((foot.xpos - pelvis.xpos)[2])
        assert seen["foot_right.axis_x.z"] == pytest.approx(foot.xmat[6])
        assert seen["foot_right.axis_z.x"] == pytest.approx(heading * foot.xmat[2])
        assert seen["pelvis.velocity.x"] == pytest.approx(heading * data.qvel[0])
        assert seen["head.angular_velocity.y"] == pytest.approx(heading * (data.qvel[2] + data.qvel[9]))
        assert seen["head.angular_velocity.x"] == pytest.approx(0.0)


def test_postures_are_mujocos(model: mujoco.MjModel) -> None:
    states = np.random.default_rng(0).uniform(-1, 1, (20, 20))
    _, postures = PlanarObserver(model)(*(np.ascontiguousarray(part) for part in np.split(states, 2, axis=1)))
    for state, posture in zip(states, postures, strict=True):
        data = moved(model, state)
        pelvis, left, right, head = (
            data.body(name).xpos[[0, 2]] for name in ("pelvis", "foot_left", "foot_right", "head")
        )
        assert posture[GAIT_FEATURES] == pytest.approx([pelvis[1], *(left - pelvis), *(right - pelvis)], abs=1e-12)
        assert posture[TRUNK_LEAN] == pytest.approx(np.arctan2(*(head - pelvis)))
        assert posture[HEAD_HEIGHT] == pytest.approx(head[1])


def test_mirror_of_state_observation_and_step(body: ModuleType, model: mujoco.MjModel) -> None:
    env = PlanarHumanoidVectorEnv(
        model=model, num_envs=32, fall_pelvis_height=0, fall_head_height=0, fall_trunk_lean=9, compact=True
    )
    env.reset(seed=1)
    joints, states = body.WALKER.mirror_joints(), env.states()
    mirrored = np.concatenate([joints.image(part) for part in np.split(states, 2, axis=1)], axis=1)
    assert np.abs(mirrored - states).max() > 0.1
    action = np.random.default_rng(0).uniform(-1, 1, (32, 7)).astype(np.float32)
    first = env.set_states(states)
    assert np.abs(env.mirror_observation.image(first) - env.set_states(mirrored)).max() < 1e-6
    following = env.step(env.mirror_action.image(action))[0]
    env.set_states(states)
    assert np.abs(env.mirror_observation.image(env.step(action)[0]) - following).max() < 1e-5


def test_mirror_of_every_number(body: ModuleType, model: mujoco.MjModel) -> None:
    """Those that are constant in the plane, too: on the free body, turned and moved out of it."""
    free = mujoco.MjModel.from_xml_path(str(body.XML))
    mirror = PlanarHumanoidEnv(model=model).mirror_observation
    generator = np.random.default_rng(3)
    data, other = mujoco.MjData(free), mujoco.MjData(free)
    joints = body.WALKER.mirror_action()
    turn = np.array([1.0, *generator.uniform(-0.4, 0.4, 3)])
    turn /= np.linalg.norm(turn)
    angles, rates, linear, angular = (generator.normal(size=size) for size in (7, 7, 3, 3))
    # left and right exchanged: y and the pseudovectors' x and z change their signs
    for of, sign, image in ((data, 1.0, lambda v: v), (other, -1.0, joints.image)):
        of.qpos[:3], of.qpos[7:] = (0.0, sign * 0.2, 1.0), image(angles)
        of.qpos[3:7] = turn * np.array([1.0, sign, 1.0, sign])
        of.qvel[:3], of.qvel[3:6] = linear * [1, sign, 1], angular * [sign, 1, sign]
        of.qvel[6:] = image(rates)
        mujoco.mj_forward(free, of)
    seen, image = observe(free, data, body.WALKER), observe(free, other, body.WALKER)
    assert np.abs(mirror.image(seen) - image).max() < 1e-9
    assert np.abs(seen - image).max() > 0.1


def test_both_environments_agree(model: mujoco.MjModel) -> None:
    many, one = PlanarHumanoidVectorEnv(model=model, num_envs=1), PlanarHumanoidEnv(model=model)
    assert np.array_equal(many.reset(seed=3)[0][0], one.reset(seed=3)[0])
    assert one.observation_names == many.observation_names
    assert one.action_names == many.action_names
    action = np.full((1, 7), 0.1, np.float32)
    assert np.array_equal(many.step(action)[4]["final_obs"][0], one.step(action[0])[0])
    many.push(np.array([100.0]))
    forward = many.states()[0, 10]
    many.step(action)
    assert many.states()[0, 10] > forward


def test_poses_of_a_reference(body: ModuleType, model: mujoco.MjModel) -> None:
    phase = 2 * np.pi * 1.5 * np.arange(60) / 30
    left, right = np.sin(phase), np.sin(phase + np.pi)
    features = np.stack((0.85 + 0 * phase, 0.3 * left, -0.7 + 0.05 * left, 0.3 * right, -0.7 + 0.05 * right), axis=1)
    episode = np.zeros(60, np.int32)
    states = ReferenceStates(model, features.astype(np.float32), episode, 1 / 30)
    qpos, qvel = states.draw(np.random.default_rng(0), 64)
    seen = PlanarObserver(model)(qpos, qvel)[1][:, GAIT_FEATURES]
    both = np.concatenate((features, MIRROR.image(features)))
    assert np.abs(seen[:, None] - both).max(axis=2).min(axis=1).max() < 0.05  # between two of its steps


def test_power_and_contact_of_the_feet(model: mujoco.MjModel) -> None:
    states = np.zeros((2, 20))
    states[:, 1] = STANDING - 0.002, STANDING + 0.3
    loads = replay(model, states, np.zeros((2, 7)), substeps=1)
    assert loads.contact.tolist() == [[True, True], [False, False]]
    assert (loads.power >= loads.positive_power).all()
    assert (loads.positive_power >= 0).all()


def test_drawings_have_a_far_side(body: ModuleType, model: mujoco.MjModel) -> None:
    far = body.WALKER.right_side
    lines, faint = film.side_view(model, np.zeros(10), far)
    assert lines.shape == (8, 2, 2)
    assert faint.sum() == 3
    assert sum(part.far for part in scene.segments(model, far)) == 3


def test_a_picture(model: mujoco.MjModel) -> None:
    state, nowhere = np.zeros(20), np.zeros(20)
    state[:2], nowhere[1] = (7.0, STANDING), -9.0
    try:
        with SideCamera(model, width=160, height=120) as camera:
            picture, empty = camera.frame(state), camera.frame(nowhere)
    except RenderingError as error:
        pytest.skip(str(error))
    rows, columns = np.nonzero(np.abs(picture.astype(int) - empty).sum(axis=2) > 60)
    assert 60 < np.ptp(rows) < 120
    assert np.ptp(columns) < 60


def test_what_does_not_fit_is_refused(body: ModuleType) -> None:
    with pytest.raises(ConfigurationError, match=r"humanoid\.xml: no body named Pelvis, as the skeleton smpl has"):
        build(xml=body.XML)
    with pytest.raises(ConfigurationError, match=r"humanoid.skeleton: walker is not allowed"):
        build(skeleton=body.WALKER)
    with pytest.raises(ValueError, match="tail is none of its bodies"):
        replace(body.WALKER, pushed="tail")
    with pytest.raises(ValueError, match="turns no axis of the root forward"):
        replace(body.WALKER, base_quaternion=(0.9, 0.1, 0.3, 0.3))


def test_configured(body: ModuleType, smoke_config: Config) -> None:
    from romgrl.humanoid.model import configured

    smoke_config.humanoid.xml, smoke_config.humanoid.skeleton = str(body.XML), "walker"
    assert skeleton_of(configured(smoke_config.humanoid)) is body.WALKER


def test_arms_of_a_t_pose_hang_in_other_axes_too(body: ModuleType, tmp_path: Path) -> None:
    """With a quarter turn about the forward axis, here the local x."""
    text, servo = body.XML.read_text(encoding="utf-8"), ""
    for side, out in (("left", 1), ("right", -1)):
        geom = f'<geom fromto="0 0 0 0 {0.25 * out} 0" size="0.03" mass="1"/>'
        arm = (
            f'<body name="upper_arm_{side}" pos="0 {0.2 * out} 0.3"><joint name="upper_arm_{side}"/>{geom}'
            f'<body name="forearm_{side}" pos="0 {0.3 * out} 0"><joint name="forearm_{side}" axis="0 0 1"/>{geom}'
            "</body></body>"
        )
        text = text.replace('<body name="head"', arm + '<body name="head"')
        servo += "".join(f'<general joint="{name}_{side}" class="waist"/>' for name in ("upper_arm", "forearm"))
    text = text.replace("damping", 'range="-2 2" damping').replace("</actuator>", servo + "</actuator>")
    (tmp_path / "arms.xml").write_text(text, encoding="utf-8")
    tree = {name: parent for name, parent in body.WALKER.parents.items() if name != "head"}
    for side in ("left", "right"):
        tree |= {f"upper_arm_{side}": "trunk", f"forearm_{side}": f"upper_arm_{side}"}
    armed = replace(
        body.WALKER,
        name="armed",
        parents=tree | {"head": "trunk"},
        left=body.WALKER.left._replace(shoulder="upper_arm_left", elbow="forearm_left"),
    )
    SKELETONS["armed"] = armed
    data = mujoco.MjData(build(xml=tmp_path / "arms.xml", skeleton=armed))
    mujoco.mj_kinematics(data.model, data)
    for side in ("left", "right"):
        drop = data.body(f"forearm_{side}").xpos - data.body(f"upper_arm_{side}").xpos
        assert drop == pytest.approx([0, 0, -0.3], abs=1e-12)
    assert np.abs(data.xaxis - [[1, 0, 0], [0, 0, 1], *[[0, 1, 0]] * 12]).max() < 1e-9
    env = PlanarHumanoidVectorEnv(model=data.model, num_envs=4)
    states = (env.reset(seed=0), env.states())[1]
    mirrored = np.concatenate([armed.mirror_joints().image(part) for part in np.split(states, 2, axis=1)], axis=1)
    image = env.mirror_observation.image(env.set_states(states))
    assert np.abs(image - env.set_states(mirrored)).max() < 1e-6
