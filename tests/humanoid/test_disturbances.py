"""Pushes and scaled models against the laws of mechanics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.humanoid.changed_body import scaled
from romgrl.humanoid.model import build, dimensions
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

NO_FALL = {"fall_pelvis_height": 0.0, "fall_head_height": 0.0, "fall_trunk_lean": 9.0}
REST = np.zeros((2, 21), np.float32)


def forward_momentum(model: mujoco.MjModel, states: NDArray[np.float64]) -> list[float]:
    """Of the whole body, N s."""
    data, found = mujoco.MjData(model), []
    for state in states:
        data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        found.append(float(model.body_mass.sum() * data.subtree_linvel[0, 0]))
    return found


def in_the_air(env: PlanarHumanoidVectorEnv) -> None:
    """Every humanoid 5 m above the ground, running through the air at 3 m/s."""
    states = np.zeros((env.num_envs, env.model.nq + env.model.nv))
    states[:, 1], states[:, env.model.nq] = 5.0, 3.0
    env.set_states(states)


@pytest.mark.parametrize("impulse", [21.9, -43.8])
def test_an_impulse_changes_the_momentum_by_itself(impulse: float) -> None:
    env = PlanarHumanoidVectorEnv(num_envs=2, **NO_FALL)
    in_the_air(env)
    before = forward_momentum(env.model, env.states())
    assert before[0] == pytest.approx(3.0 * dimensions(env.model).mass)
    env.push(np.array([impulse / (3 * env.control_step), 0.0]))
    for _ in range(3):
        env.step(REST)
    pushed, other = np.subtract(forward_momentum(env.model, env.states()), before)
    assert pushed == pytest.approx(impulse, rel=0.01)
    assert abs(other) < 0.01 * abs(impulse)  # servos and joints are internal forces
    env.push(np.zeros(2))
    for _ in range(3):
        env.step(REST)
    later = np.subtract(forward_momentum(env.model, env.states()), before)
    assert later[0] == pytest.approx(impulse, rel=0.01)


def test_the_push_acts_on_the_chest_and_ends_with_the_episode() -> None:
    env = PlanarHumanoidVectorEnv(num_envs=2, **NO_FALL)
    in_the_air(env)
    env.push(np.array([300.0, 300.0]))
    assert np.flatnonzero(env.state()["states"][0] == 300.0).size == 1
    env._restart(np.array([1]))
    assert 300.0 in env.state()["states"][0]
    assert 300.0 not in env.state()["states"][1]
    in_the_air(env)
    env.push(np.array([300.0, -300.0]))
    forward, backward = env.step(REST)[-1]["trunk_lean"]
    assert forward > backward  # the chest is above the centre of mass


def test_scaled_mass_scales_every_inertia_and_nothing_else() -> None:
    model = build()
    heavy = scaled(model, mass=1.2)
    for one, times in ((model, 1.2), (heavy, 1.0)):
        data, matrix = mujoco.MjData(one), np.zeros((one.nv, one.nv))
        data.qpos[1] = 1.0
        data.qpos[3:] = np.linspace(-0.3, 0.3, one.nv - 3)
        mujoco.mj_forward(one, data)
        for column in range(one.nv):
            unit, product = np.eye(one.nv)[column], np.zeros(one.nv)
            mujoco.mj_mulM(one, data, product, unit)
            matrix[:, column] = product
        matrix -= np.diag(one.dof_armature)
        if times == 1.2:
            expected = times * matrix
        else:
            np.testing.assert_allclose(matrix, expected, rtol=1e-9, atol=1e-9)
    assert dimensions(heavy).mass == pytest.approx(1.2 * dimensions(model).mass)
    assert dimensions(heavy).pelvis_height == dimensions(model).pelvis_height
    np.testing.assert_array_equal(heavy.actuator_forcerange, model.actuator_forcerange)
    assert dimensions(model).mass == pytest.approx(dimensions(build()).mass, abs=0)  # the original is as it was


def test_scale_one_changes_no_bit() -> None:
    model = build()
    same = scaled(model)
    for name in dir(model):
        field = getattr(model, name)
        if isinstance(field, np.ndarray):
            np.testing.assert_array_equal(field, getattr(same, name), err_msg=name)


@pytest.mark.parametrize("friction", [0.8, 1.2])
def test_a_block_slides_with_the_scaled_friction(friction: float) -> None:
    """F = -mu N (Coulomb), with the larger of the two coefficients."""
    block = """<mujoco><option timestep="0.001" cone="elliptic" impratio="100"/><worldbody>
      <geom name="floor" type="plane" size="9 9 1" friction="0.5"/>
      <body pos="0 0 0.1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
      <geom type="box" size="0.1 0.1 0.1" mass="1" friction="0.4"/></body></worldbody></mujoco>"""
    model = scaled(mujoco.MjModel.from_xml_string(block), friction=friction)
    data = mujoco.MjData(model)
    for _ in range(300):  # settle on the floor
        mujoco.mj_step(model, data)
    data.qvel[0] = 4.0
    for _ in range(100):
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        along, normal = data.qfrc_constraint
        assert along == pytest.approx(-0.5 * friction * normal, rel=1e-3)
    assert 0.0 < data.qvel[0] < 4.0


def test_the_ground_under_the_humanoid_has_the_scaled_friction() -> None:
    model = scaled(build(), friction=0.8)
    data = mujoco.MjData(model)
    data.qpos[1] = dimensions(model).pelvis_height - 0.005
    mujoco.mj_forward(model, data)
    assert len(data.contact.friction) > 0
    np.testing.assert_allclose(data.contact.friction[:, :2], 0.8)
