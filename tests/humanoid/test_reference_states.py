"""Poses of the humanoid that follow a reference."""

import mujoco
import numpy as np
import pytest

from romgrl.gait.features import MIRROR
from romgrl.humanoid.model import build, lowest_point
from romgrl.humanoid.planar_observer import GAIT_FEATURES, PlanarObserver
from romgrl.humanoid.reference_states import LARGEST_JOINT_SPEED, ReferenceStates, follow
from romgrl.humanoid.skeleton import SMPL
from romgrl.humanoid.start_states import MixedStates, StrideStates
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

DT = 1 / 30
TIMES = np.arange(300) * DT
EPISODE = np.repeat([0, 1], 150).astype(np.int32)


@pytest.fixture(scope="module")
def model():
    return build()


@pytest.fixture(scope="module")
def features():
    """A run at 1.5 strides/s, in reach of the legs: an ellipse for each ankle, half a stride apart."""
    phase = 2 * np.pi * 1.5 * TIMES
    feet = [
        column
        for shift in (0, np.pi)
        for column in (-0.05 + 0.3 * np.cos(phase + shift), -0.7 + 0.06 * np.sin(phase + shift))
    ]
    return np.stack([0.9 + 0.03 * np.cos(2 * phase), *feet], axis=1).astype(np.float32)


def seen(model, qpos):
    return PlanarObserver(model)(qpos, np.zeros_like(qpos))[1][:, GAIT_FEATURES]


def test_pelvis_and_ankles_lie_where_the_reference_has_them(model, features):
    assert np.abs(seen(model, follow(model, features.astype(float))) - features).max() < 1e-6


def test_the_angles_of_a_pose_come_back_from_its_own_features(model):
    generator, legs = np.random.default_rng(0), [f"{side}_{joint}" for side in "LR" for joint in ("Hip", "Knee")]
    columns, qpos = [SMPL.column[name] for name in legs], np.zeros((50, model.nq))
    qpos[:, columns] = generator.uniform([-0.8, 0.25, -0.8, 0.25], [0.4, 1.8, 0.4, 1.8], (50, 4))
    assert np.allclose(follow(model, seen(model, qpos))[:, columns], qpos[:, columns], atol=1e-9)


def test_a_foot_out_of_reach_leaves_the_leg_nearly_straight_and_pointing_at_it(model):
    far = np.array([[0.9, 1.0, -1.0, -1.0, -1.0]])
    left, right = seen(model, follow(model, far))[0, 1:].reshape(2, 2)
    assert left[0] > 0.4
    assert right[0] < -0.3
    assert follow(model, far)[0, SMPL.column["L_Knee"]] < 0.25


def drawn(model, features, count, seed=0):
    return ReferenceStates(model, features, EPISODE, DT).draw(np.random.default_rng(seed), count)


def test_joint_speeds_move_the_feet_as_the_reference_does(model, features):
    qpos, qvel = drawn(model, features, 64)
    slow = np.flatnonzero(np.abs(qvel[:, 3:]).max(1) < LARGEST_JOINT_SPEED)
    moved = (seen(model, qpos + 1e-4 * qvel) - seen(model, qpos))[slow] / 1e-4
    velocities = np.gradient(features, DT, axis=0)
    both = np.concatenate((features[1:-1], MIRROR.image(features[1:-1])))
    speeds = np.concatenate((velocities[1:-1], MIRROR.image(velocities[1:-1])))
    nearest = np.abs(seen(model, qpos)[slow, None] - both).max(-1).argmin(1)
    assert len(slow) > 20
    assert np.abs(moved[:, 1:] - speeds[nearest, 1:]).max() < 0.6  # feet move at up to 3 m/s; half a step of 1/30 s


def test_no_pose_is_below_the_floor_and_half_are_mirrored(model, features):
    low = features.copy()
    low[:, 0] -= 0.2
    qpos, _ = drawn(model, low, 200)
    data = mujoco.MjData(model)
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        assert lowest_point(model, data) > -1e-9
    asymmetric = features.copy()
    asymmetric[:, 1] += 0.1  # the left foot is ahead on average
    ahead = seen(model, drawn(model, asymmetric, 400)[0])
    assert np.mean(ahead[:, 1] - ahead[:, 3]) == pytest.approx(0.0, abs=0.06)


def test_states_are_drawn_anew_between_the_steps_of_the_reference(model, features):
    first, second = drawn(model, features, 100)[0], drawn(model, features, 100, seed=1)[0]
    assert len(np.unique(np.concatenate((first, second)), axis=0)) == 200
    again = drawn(model, features, 100)[0]
    assert np.array_equal(first, again)
    both = np.concatenate((features, MIRROR.image(features)))
    apart = np.abs(seen(model, first)[:, None] - both).max(-1).min(1)
    assert 0 < np.median(apart) < apart.max() < 0.06


def test_episodes_shorter_than_four_steps_are_refused(model, features):
    with pytest.raises(ValueError, match="holds four steps"):
        ReferenceStates(model, features[:6], np.array([0, 0, 0, 1, 1, 1], np.int32), DT)


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_share_of_the_episodes_starts_from_the_reference(model, features, share):
    env = PlanarHumanoidVectorEnv(model=model, num_envs=400, speed=4.0)
    env.start_from(ReferenceStates(model, features, EPISODE, DT), share)
    env.reset(seed=0)
    qpos, qvel = np.split(env.states(), 2, axis=1)
    theirs = (qpos[:, [SMPL.column[name] for name in SMPL.trunk]] == 0).all(
        axis=1
    )  # the others' trunks are not upright
    assert abs(theirs.mean() - share) < 0.08
    assert 0 <= qvel[:, 0].min() < qvel[:, 0].max() <= 4.0


def test_a_mixture_draws_its_rows_one_by_one(model, features):
    mixed = MixedStates(StrideStates(model), ReferenceStates(model, features, EPISODE, DT), 0.5)
    assert [len(part) for part in mixed.draw(np.random.default_rng(0), 0)] == [0, 0]
    assert mixed.draw(np.random.default_rng(0), 3)[0].shape == (3, model.nq)
