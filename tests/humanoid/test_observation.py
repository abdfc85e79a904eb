"""HumEnv's observation, one at a time and many together, its columns and its mirror image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from romgrl.humanoid import _core
from romgrl.humanoid.model import build, dimensions
from romgrl.humanoid.observation import observe, varying_columns
from romgrl.humanoid.planar_observer import FASTEST, GAIT_FEATURES, SOLE_HEIGHT, TRUNK_LEAN, PlanarObserver
from romgrl.humanoid.skeleton import SMPL
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv
from tests.humanoid.files import humenv_cases, humenv_xml


def planar_data(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    return data


def test_equals_humenv() -> None:
    model = mujoco.MjModel.from_xml_path(str(humenv_xml()))
    cases = np.load(humenv_cases(), allow_pickle=False)
    assert len(cases["qpos"]) >= 64
    for qpos, qvel, expected in zip(cases["qpos"], cases["qvel"], cases["observation"], strict=True):
        observation = observe(model, planar_data(model, qpos, qvel))
        assert observation.dtype == np.float64
        assert np.abs(observation - expected).max() < 1e-6


def test_standing_by_hand() -> None:
    """Standing at height 1 and moving forward at 2 m/s while pitching at 3 rad/s."""
    model = build()
    qvel = np.zeros(24)
    qvel[0], qvel[2] = 2.0, 3.0
    qpos = np.zeros(24)
    qpos[1] = 1.0
    observation = observe(model, planar_data(model, qpos, qvel))
    assert observation.shape == (SMPL.observation_size,)
    assert observation[0] == 1.0
    left_hip = model.body("L_Hip").pos  # left, up, forward
    assert observation[1:4] == pytest.approx([0.0, left_hip[0], left_hip[1]])
    assert observation[70:76] == pytest.approx([0, 1, 0, 1, 0, 0])  # local x points left, local z forward
    assert observation[214:217] == pytest.approx([2, 0, 0])
    hip_below = -left_hip[1]
    assert observation[217:220] == pytest.approx([2 - 3 * hip_below, 0, 0])
    assert observation[286:289] == pytest.approx([0, 3, 0])


def test_heading_is_removed() -> None:
    """On a free root, turning about the vertical changes nothing."""
    spec = mujoco.MjSpec.from_string(FREE_BODIES)
    model = spec.compile()
    generator = np.random.default_rng(0)
    qvel = generator.normal(size=model.nv)
    seen = []
    for angle in (0.0, 2.0):
        data = mujoco.MjData(model)
        turn = np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
        upright = np.array([0.5, 0.5, 0.5, 0.5])
        mujoco.mju_mulQuat(data.qpos[3:7], turn, upright)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, turn)
        data.qvel[:] = qvel
        data.qvel[:3] = rotation.reshape(3, 3) @ qvel[:3]
        mujoco.mj_forward(model, data)
        seen.append(observe(model, data))
    assert seen[0] == pytest.approx(seen[1], abs=1e-12)


def _chain() -> str:
    geom = "<geom size='0.1' mass='1'/>"
    opening = "".join(
        f"<body name='{name}' pos='0.1 0.05 0.02'>{geom}" + ("<freejoint/>" if name == "Pelvis" else "")
        for name in SMPL.bodies
    )
    return f"<mujoco><worldbody>{opening}{'</body>' * len(SMPL.bodies)}</worldbody></mujoco>"


FREE_BODIES = _chain()


def humanoids() -> list[Any]:
    return [
        pytest.param(lambda: build(), id="own"),
        pytest.param(lambda: build(xml=humenv_xml(), substeps=15), id="humenv"),
    ]


@pytest.mark.parametrize("make", humanoids())
def test_planar_observer_equals_observe(make: Callable[[], mujoco.MjModel]) -> None:
    """Upside down and facing backward too, to float32 rounding."""
    model, generator = make(), np.random.default_rng(0)
    qpos, qvel = generator.uniform(-3, 3, (200, 24)), generator.normal(0, 5, (200, 24))
    seen, _ = PlanarObserver(model)(qpos, qvel)
    assert (np.cos(qpos[:, 2]) < 0).any()
    for row in range(200):
        data = planar_data(model, qpos[row], qvel[row])
        assert seen[row] == pytest.approx(observe(model, data), rel=2e-7, abs=1e-12)


@pytest.mark.parametrize("make", humanoids())
def test_postures_are_mujocos(make: Callable[[], mujoco.MjModel]) -> None:
    model, generator = make(), np.random.default_rng(0)
    qpos, qvel = generator.uniform(-1, 1, (50, 24)), generator.normal(0, 5, (50, 24))
    _, postures = PlanarObserver(model)(qpos, qvel)
    for row, posture in enumerate(postures):
        data = planar_data(model, qpos[row], qvel[row])
        pelvis, left, right, neck = (data.body(name).xpos for name in ("Pelvis", "L_Ankle", "R_Ankle", "Neck"))
        features = [pelvis[2], *(left - pelvis)[[0, 2]], *(right - pelvis)[[0, 2]]]
        lean = np.arctan2((neck - pelvis)[0], (neck - pelvis)[2])
        fastest = np.abs(qvel[row]).max()
        assert posture[:FASTEST] == pytest.approx([*features, lean, data.body("Head").xpos[2]], abs=1e-12)
        assert posture[FASTEST] == fastest
        assert posture[SOLE_HEIGHT] == pytest.approx([gap(model, data, side) for side in "LR"], abs=1e-6)


def gap(model: mujoco.MjModel, data: mujoco.MjData, side: str) -> float:
    """Height of a foot above the floor as MuJoCo's collision of shapes has it, m."""
    touches = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    touching = {*model.pair_geom1, *model.pair_geom2, *touches}
    floor = next(geom for geom in range(model.ngeom) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE)
    feet = {model.body(f"{side}_{part}").id for part in ("Ankle", "Toe")}
    shapes = [geom for geom in touching if model.geom_bodyid[geom] in feet]
    return min(mujoco.mj_geomDistance(model, data, floor, geom, 10.0, None) for geom in shapes)


def test_posture_by_hand() -> None:
    """The whole body, standing, pitches forward by 0.3 rad about a pelvis at height 1."""
    model = build()
    qpos, qvel = np.zeros((3, 24)), np.zeros((3, 24))
    qpos[:, :3], qvel[0, 7] = (5.0, 1.0, 0.3), -4.0
    qpos[1, 9], qvel[2, 9] = np.nan, np.inf
    _, posture = PlanarObserver(model)(qpos, qvel)
    leg = dimensions(model).leg_length
    assert posture[0, GAIT_FEATURES] == pytest.approx([1.0, *2 * (-leg * np.sin(0.3), -leg * np.cos(0.3))])
    assert posture[0, TRUNK_LEAN] == pytest.approx(0.3)
    assert posture[:, FASTEST].tolist() == [4.0, np.inf, np.inf]


def test_planar_observer_reads_rows_of_a_larger_array() -> None:
    model, states = build(), np.random.default_rng(0).uniform(-1, 1, (6, 100))
    columns = varying_columns(model)
    qpos, qvel = states[:, 3:27], states[:, 40:64]
    whole, postures = PlanarObserver(model)(qpos, qvel)
    some, posture = PlanarObserver(model, columns)(qpos[2:4].copy(), qvel[2:4].copy())
    assert np.array_equal(some, whole[2:4][:, columns])
    assert np.array_equal(posture, postures[2:4])


def test_planar_observer_rejects_wrong_shapes() -> None:
    observer = PlanarObserver(build())
    with pytest.raises(ValueError, match="qpos"):
        observer(np.zeros((2, 23)), np.zeros((2, 24)))
    with pytest.raises(ValueError, match="qvel"):
        observer(np.zeros((2, 24)), np.zeros((1, 24)))
    with pytest.raises(ValueError, match="column"):
        PlanarObserver(build(), np.array([358]))(np.zeros((2, 24)), np.zeros((2, 24)))


def test_vectorised_equals_observe() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=16)
    env.reset(seed=0)
    generator = np.random.default_rng(1)
    for _ in range(5):
        observation, *_ = env.step(generator.uniform(-1, 1, (16, 21)).astype(np.float32))
    for row, state in enumerate(env.states()):
        expected = observe(env.model, planar_data(env.model, state[:24], state[24:]))
        assert observation[row] == pytest.approx(expected, rel=2e-7, abs=1e-12)


def test_compact_observations_are_columns_of_the_full_ones() -> None:
    full, compact = (PlanarHumanoidVectorEnv(num_envs=8, episode_steps=6, compact=compact) for compact in (False, True))
    columns = compact.columns
    assert np.array_equal(full.columns, np.arange(358))
    assert compact.single_observation_space.shape == (len(columns),)
    seen = full.reset(seed=0)[0]
    assert np.array_equal(seen[:, columns], compact.reset(seed=0)[0])
    image = compact.mirror_observation.image(seen[:, columns])
    assert np.array_equal(image, full.mirror_observation.image(seen)[:, columns])
    generator = np.random.default_rng(0)
    for _ in range(12):
        action = generator.uniform(-1, 1, (8, 21)).astype(np.float32)
        (whole, *_, before), (some, *_, after) = full.step(action), compact.step(action)
        assert np.array_equal(whole[:, columns], some)
        assert np.array_equal(before["final_obs"][:, columns], after["final_obs"])
    assert np.array_equal(full.set_states(full.states())[:, columns], compact.set_states(compact.states()))


def test_compact_columns() -> None:
    """In the plane: height, 23 x (x, z), 24 x local z (x, z), 24 x (vx, vz) and 24 pitch rates vary."""
    columns = varying_columns(build())
    assert len(columns) == 1 + 46 + 48 + 48 + 24
    assert np.array_equal(columns, varying_columns(build(height=1.6)))
    env = PlanarHumanoidVectorEnv(num_envs=32)
    observation, _ = env.reset(seed=0)
    constant = np.setdiff1d(np.arange(SMPL.observation_size), columns)
    generator = np.random.default_rng(0)
    for _ in range(30):
        later, *_ = env.step(generator.uniform(-1, 1, (32, 21)).astype(np.float32))
        assert np.abs(later[:, constant] - observation[:1, constant]).max() < 1e-6


def test_mirror_of_state_observation_and_step() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=64, fall_pelvis_height=0, fall_head_height=0, fall_trunk_lean=9)
    env.reset(seed=1)
    joints = SMPL.mirror_joints()
    states = env.states()
    mirrored = np.concatenate([joints.image(states[:, :24]), joints.image(states[:, 24:])], axis=1)
    action = np.random.default_rng(0).uniform(-1, 1, (64, 21)).astype(np.float32)
    first = env.set_states(states)
    assert np.abs(env.mirror_observation.image(first) - env.set_states(mirrored)).max() < 1e-6
    env.set_states(states)
    env.step(action)
    after = env.states()
    env.set_states(mirrored)
    env.step(env.mirror_action.image(action))
    other = env.states()
    assert np.abs(joints.image(after[:, :24]) - other[:, :24]).max() < 1e-6
    assert np.abs(joints.image(after[:, 24:]) - other[:, 24:]).max() < 1e-6
    assert np.array_equal(env.mirror_observation.image(env.mirror_observation.image(first)), first)


def test_users_own_humanoid_varies_in_the_plane() -> None:
    columns = varying_columns(build(xml=humenv_xml(), substeps=15))
    assert 167 <= len(columns) <= 190


def test_trees_that_the_observer_refuses() -> None:
    def tree(bodies: int, head: int = 0, soles: tuple[int, ...] = (0, 0)) -> _core.PlanarBodies:
        zeros = [[0.0, 0.0, 0.0]] * bodies
        return _core.PlanarBodies(
            parents=range(-1, bodies - 1),
            joints=[-1] * bodies,
            offsets=zeros,
            x_axes=zeros,
            z_axes=zeros,
            rest=[0.0, 0.0],
            left_ankle=0,
            right_ankle=0,
            neck=0,
            head=head,
            soles=[(body, side == 0, [0.0, 0.0, 0.0], 0.0) for side, body in enumerate(soles)],
        )

    tree(64, head=63)
    for bodies, head, reason in ((0, 0, "1 to 64 bodies"), (65, 0, "1 to 64 bodies"), (3, 3, "no such body")):
        with pytest.raises(ValueError, match=reason):
            tree(bodies, head)
    with pytest.raises(ValueError, match="no such body"):
        tree(3, soles=(0, 3))
    with pytest.raises(ValueError, match="each foot needs a sole"):
        tree(3, soles=(0,))
