"""What joints and feet bear: power of known torques and stops, contact and sliding of constructed states."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.features import LOADS
from romgrl.humanoid import loads
from romgrl.humanoid.changed_body import scaled
from romgrl.humanoid.joints import JOINTS
from romgrl.humanoid.load_sensors import add_sensors
from romgrl.humanoid.loads import Loads, replay
from romgrl.humanoid.model import build, dimensions
from romgrl.humanoid.own_body import human_spec
from romgrl.humanoid.sagittal_plane import hold_in_plane
from romgrl.humanoid.skeleton import SMPL
from romgrl.humanoid.task import controls
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

LIMIT = mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT.value
NEUTRAL = np.array([JOINTS[name.split("_")[-1]].neutral for name in SMPL.hinges])
REACH = np.array([JOINTS[name.split("_")[-1]].reach for name in SMPL.hinges])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build()


def standing(model: mujoco.MjModel, *, above: float = -0.004) -> NDArray[np.float64]:
    """State (1, 48) with straight legs, the soles `above` the ground, at rest."""
    state = np.zeros((1, model.nq + model.nv))
    state[0, 1] = dimensions(model).pelvis_height + above
    return state


def upright(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Actions (1, 21) whose servo targets are the standing pose."""
    return -(NEUTRAL / REACH)[None]


def test_a_standing_humanoid_bears_its_weight_and_does_not_slide(model: mujoco.MjModel) -> None:
    found = replay(model, standing(model), upright(model), 16)
    assert found.touching.all()
    assert found.loaded.all()
    assert not found.sliding.any()
    assert found.contact.tolist() == [[True, True]]


def test_moved_at_a_metre_per_second_it_slides(model: mujoco.MjModel) -> None:
    ice, state = scaled(model, friction=0.01), standing(model)
    state[0, 24] = 1.0
    found = replay(ice, state, upright(model), 16)
    assert found.loaded.all()
    assert found.sliding.all()
    state[0, 24] = 0.2  # below the 0.3 m/s from which on it counts
    assert not replay(ice, state, upright(model), 4).sliding.any()


def test_in_the_air_nothing_touches(model: mujoco.MjModel) -> None:
    found = replay(model, standing(model, above=0.3), upright(model), 4)
    assert not found.touching.any()
    assert not found.loaded.any()


def test_one_foot_on_the_ground(model: mujoco.MjModel) -> None:
    state = standing(model)
    state[0, SMPL.column["R_Hip"]], state[0, SMPL.column["R_Knee"]] = -0.8, 1.4
    found = replay(model, state, (state[:, 3:24] - NEUTRAL) / REACH, 4)
    assert found.touching[0].tolist() == [[True, False]] * 4
    assert found.loaded[0].any(axis=0).tolist() == [True, False]


def test_a_foot_that_just_touches_is_not_loaded(model: mujoco.MjModel) -> None:
    """It lifts off at 0.3 m/s, with the soles still a millimetre deep."""
    state = standing(model, above=-0.001)
    state[0, 25] = 0.3
    found = replay(model, state, upright(model), 1)
    assert found.touching.all()
    assert not found.loaded.any()


def test_only_the_ground_is_touched() -> None:
    """A file's pair of shapes, here of thigh and foot, which overlap, is no contact with the ground."""
    spec = human_spec(height=1.741, mass=73.0)
    for body in ("L_Hip", "L_Ankle"):
        spec.body(body).add_geom(name=f"ball_{body}", size=[0.5, 0, 0], contype=0, conaffinity=0, mass=0)
    spec.add_pair(geomname1="ball_L_Hip", geomname2="ball_L_Ankle")
    hold_in_plane(spec, actuation="servo")
    add_sensors(spec, SMPL)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[1] = 5.0
    mujoco.mj_forward(model, data)
    assert data.ncon == 1
    assert not replay(model, standing(model, above=1.0), upright(model), 1).contact.any()


def free_knee() -> mujoco.MjModel:
    """Torque actuators; no weight, no springs, no damping."""
    model = build(actuation="torque")
    model.opt.gravity[:] = 0.0
    model.jnt_stiffness[:], model.jnt_stiffnesspoly[:], model.dof_damping[:] = 0.0, 0.0, 0.0
    return model


def in_the_air(model: mujoco.MjModel) -> NDArray[np.float64]:
    state = standing(model, above=2.0)
    state[0, 3:24] = model.jnt_range[3:].mean(axis=1)
    return state


@pytest.mark.parametrize(("speed", "positive"), [(3.0, True), (-3.0, False)])
def test_power_of_a_known_torque(speed: float, positive: bool) -> None:
    """Torque times the knee's speed, as torque times angle of a simulation with 64 times as many steps has it."""
    model, action = free_knee(), np.zeros((1, 21))
    state, index = in_the_air(model), SMPL.column["L_Knee"]
    state[0, 24 + index], action[0, SMPL.hinges.index("L_Knee")] = speed, 0.02
    found = replay(model, state, action, 4)
    fine = copy.copy(model)
    fine.opt.timestep /= 64
    data = mujoco.MjData(fine)
    data.qpos[:], data.qvel[:] = np.split(state[0], 2)
    data.ctrl[:] = action[0]
    mujoco.mj_step(fine, data, nstep=4 * 64)
    torque = action.max() * model.actuator("L_Knee").gainprm[0]
    turned = data.qpos[index] - state[0, index]
    assert np.sign(turned) == np.sign(speed)
    seconds = 4 * model.opt.timestep
    assert found.power[0] == pytest.approx(torque * abs(turned) / seconds, rel=5e-3)
    assert found.positive_power[0] == pytest.approx(found.power[0] if positive else 0.0)
    assert found.stop_share[0] == 0.0


def test_torque_of_a_stop_counts() -> None:
    """A knee that runs into its stop: what the stop takes up is the work of the lost energy, and all of it negative."""
    model, index = free_knee(), SMPL.column["L_Knee"]
    state = in_the_air(model)
    state[0, index], state[0, 24 + index] = 0.01, -3.0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.split(state[0], 2)

    def energy() -> float:
        mujoco.mj_forward(model, data)
        product = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, product, data.qvel)
        return 0.5 * float(product @ data.qvel)

    before = energy()
    found = replay(model, state, np.zeros((1, 21)), 16)
    mujoco.mj_step(model, data, nstep=16)
    lost = before - energy()
    assert lost > 0.2 * before
    work = (found.power[0] - 2 * found.positive_power[0]) * 16 * model.opt.timestep
    assert work == pytest.approx(lost, rel=0.05)
    assert found.positive_power[0] < 0.1 * found.power[0]
    assert found.stop_share[0] > 0.05


@pytest.mark.parametrize("angle", [-0.66, 0.88])
def test_an_ankle_on_either_stop(model: mujoco.MjModel, angle: float) -> None:
    state = in_the_air(model)
    assert not replay(model, state, upright(model), 1).ankle_stop.any()
    state[0, SMPL.column["R_Ankle"]], state[0, 24 + SMPL.column["R_Ankle"]] = angle, 10.0 * np.sign(angle)
    action = upright(model)
    action[0, SMPL.hinges.index("R_Ankle")] = np.sign(angle)
    found = replay(model, state, action, 1)
    assert found.ankle_stop[0, 0].tolist() == [False, True]
    assert found.stop_share[0] > 0


def test_share_of_a_stop_is_of_the_actuators_largest_torque(model: mujoco.MjModel) -> None:
    """By the constraint force of MuJoCo itself."""
    state = in_the_air(model)
    state[0, SMPL.column["L_Elbow"]], state[0, 24 + SMPL.column["L_Elbow"]] = 0.02, 3.0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.split(state[0], 2)
    data.ctrl[:] = controls(model, upright(model)[0])
    mujoco.mj_forward(model, data)
    pressed = abs(data.qfrc_constraint[SMPL.column["L_Elbow"]])
    assert pressed > 1
    assert replay(model, state, upright(model), 1).stop_share[0] == pytest.approx(pressed / 40.0)


@pytest.fixture(scope="module")
def recorded(model: mujoco.MjModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """States (40, 48) of a fall with random actions, and those (40, 21)."""
    env = PlanarHumanoidVectorEnv(model=model, num_envs=8)
    env.reset(seed=0)
    generator, states, actions = np.random.default_rng(0), [], []
    for _ in range(5):
        states.append(env.states())
        actions.append(generator.uniform(-1.2, 1.2, (8, 21)))
        env.step(actions[-1].astype(np.float32))
    return np.concatenate(states), np.concatenate(actions)


def test_replay_equals_stepping_by_hand(
    model: mujoco.MjModel, recorded: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> None:
    """Power and contact from MuJoCo's own state, one state and one substep at a time."""
    states, actions = recorded
    found = replay(model, states, actions, 16)
    assert found.touching.any()
    assert not found.touching.all()
    feet = [[model.body(name).id for name in foot] for foot in SMPL.feet]
    data = mujoco.MjData(model)
    for row in range(0, len(states), 7):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = np.split(states[row], 2)
        data.ctrl[:] = controls(model, actions[row])
        power = np.zeros(21)
        for substep in range(16):
            before = data.qvel[3:].copy()
            mujoco.mj_step(model, data)
            limits = [(data.efc_id[i], data.efc_force[i]) for i in range(data.nefc) if data.efc_type[i] == LIMIT]
            stops = np.zeros(model.njnt)
            for joint, force in limits:
                middle = model.jnt_range[joint].mean()
                stops[joint] = force if data.qpos[joint] < middle else -force
            speed = 0.5 * (before + data.qvel[3:])
            power += np.abs(data.qfrc_actuator[3:] * speed) + np.abs(stops[3:] * speed)
            bodies = {int(model.geom_bodyid[geom]) for geom in data.contact.geom.ravel()}
            assert found.touching[row, substep].tolist() == [bool(bodies & set(foot)) for foot in feet]
        assert found.power[row] == pytest.approx(power.sum() / 16, rel=1e-9)


def test_neither_rows_nor_threads_change_a_bit(
    model: mujoco.MjModel, recorded: tuple[NDArray[np.float64], NDArray[np.float64]], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = replay(model, *recorded, 16).arrays()
    threads = replay(model, *recorded, 16, num_threads=2).arrays()
    monkeypatch.setattr(loads, "_ROWS", 7)
    rows = replay(model, *recorded, 16).arrays()
    for name, values in whole.items():
        assert np.array_equal(values, threads[name]), name
        assert np.array_equal(values, rows[name]), name


def test_the_model_stays_as_it_is(model: mujoco.MjModel) -> None:
    """The sensors cost the environments nothing: they are off but in the copy that is replayed."""
    flag = mujoco.mjtDisableBit.mjDSBL_SENSOR.value
    replay(model, standing(model), upright(model), 1)
    assert model.opt.disableflags & flag
    assert model.nsensor == 21 + 2


def test_what_the_gait_reads_is_recorded() -> None:
    assert set(LOADS) < Loads.empty(1, substeps=1).arrays().keys()


def test_empty_and_put() -> None:
    space, one = Loads.empty(2, 3, substeps=4), Loads.empty(2, substeps=4)
    assert space.touching.shape == (2, 3, 4, 2)
    for values in one.arrays().values():
        values[:] = 1
    space.put((1, slice(0, 2)), one)
    for name, values in space.arrays().items():
        assert values.reshape(6, -1).all(axis=1).tolist() == [False, False, False, True, True, False], name
    assert space.contact.shape == (2, 3, 2)
    assert replay(build(), np.zeros((0, 48)), np.zeros((0, 21)), 4).power.shape == (0,)
