"""The native engine against Box2D: the same equations, so the same numbers but for Box2D's float32."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.features import POWERS
from tests.helpers.rom_worlds import WALKER, Worlds, core_parameters, pose

LENGTH, RADIUS = 0.865, 0.072
Array = NDArray[Any]


def pair(num_worlds: int, **values: Any) -> tuple[Worlds, Worlds]:
    """Worlds in Box2D and in the native engine, at the start of the same episodes."""
    box2d = Worlds(core_parameters(engine_is_native=False, **values), num_worlds)
    native = Worlds(core_parameters(engine_is_native=True, **values), num_worlds)
    for worlds in (box2d, native):
        worlds.batch.seed(2)
        worlds.batch.reset()
    return box2d, native


def wild_pose(rng: np.random.Generator) -> Any:
    """Fast legs near their stops, the feet on the ground or up to 10 cm above it."""
    angle, length = rng.uniform(-1.2, 1.2, 2), rng.uniform(0.6, 0.9, 2)
    height = float((length * np.cos(angle)).max() + RADIUS + rng.choice([0.0, 0.1]) * rng.uniform())
    legs = {"hip_angle": angle, "leg_length": length}
    rates = {"hip_rate": rng.uniform(-15.0, 15.0, 2), "leg_rate": rng.uniform(-8.0, 8.0, 2)}
    return pose(y=height, vx=rng.uniform(0.0, 5.0), vy=rng.uniform(-1.0, 1.0), **legs, **rates)


@pytest.mark.parametrize("trunk_locked", [True, False])
@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_a_substep_is_box2ds(trunk_locked: bool, friction: float) -> None:
    """From the same state, in flight, on the ground and at all stops: positions and velocities to 1e-4 in SI units.

    But for one world-step in two thousand, where rounding decides if a leg is loaded.
    """
    values = {"trunk_locked": trunk_locked, "friction": friction, "fall_height": 0.0, "trunk_pitch_limit": 10.0}
    box2d, native = pair(200, **values, control_frequency=480.0, substeps=1, episode_steps=10**6)
    rng = np.random.default_rng(7)
    for world in range(200):
        box2d.batch.place(world, wild_pose(rng))
    strain, angle, errors, forces, powers = 0.0, 0.0, [], [], []
    for _ in range(150):
        native.batch.restore(box2d.batch.save())
        action = rng.uniform(-1, 1, (200, 2)).astype(np.float32)
        box2d.step(action)
        native.step(action)
        going = ~(box2d["diverged"] | native["diverged"])
        errors.append(np.abs(native.batch.save() - box2d.batch.save())[going, WALKER].max(axis=1))
        forces.append(np.abs(native["ground_force"] - box2d["ground_force"])[going].max(axis=1))
        np.testing.assert_allclose(native["hip_torque"], box2d["hip_torque"], rtol=0, atol=1e-4)
        powers.append(
            np.max([np.abs(native[name] - box2d[name])[going] / (10 + box2d[name][going]) for name in POWERS], 0)
        )
        strain = max(strain, float(box2d["final_observation"][:, 6:8].max()))
        angle = max(angle, float(np.abs(box2d["final_observation"][:, 10:12]).max()))
    assert strain > 0.0499
    assert angle > 1.3
    assert np.quantile(np.concatenate(errors), 0.9995) < 1e-4
    assert np.quantile(np.concatenate(forces), 0.9995) < 1.0
    assert np.quantile(np.concatenate(powers), 0.9995) < 1e-3
    assert max(box2d[name].max() for name in POWERS[2:]) > 1.0


def test_control_steps_are_box2ds() -> None:
    """From the same state with the same action: observations to 5e-5 in 99% of all steps.

    In the others rounding decides in which substep something happens.
    """
    box2d, native = pair(500)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(40):
        native.batch.restore(box2d.batch.save())
        action = rng.uniform(-1, 1, (500, 2)).astype(np.float32)
        box2d.step(action)
        native.step(action)
        errors.append(np.abs(native["final_observation"] - box2d["final_observation"]).max(axis=1))
        assert (native["terminated"] != box2d["terminated"]).mean() < 0.01
    assert np.median(errors) < 1e-5
    assert np.quantile(errors, 0.99) < 5e-5


def test_starts_are_box2ds() -> None:
    """The same episodes from the same seed, also after autoresets."""
    box2d, native = pair(40, episode_steps=5)
    for _ in range(11):
        np.testing.assert_allclose(native.batch.save()[:, WALKER.stop :], box2d.batch.save()[:, WALKER.stop :])
        for worlds in (box2d, native):
            worlds.step()
    np.testing.assert_allclose(native["observation"][:, 2], box2d["observation"][:, 2], atol=0.02)
    assert native["terminated"].sum() == 0


def test_episodes_are_alike() -> None:
    """Random actions over 60 steps: falls, and speed and height of the worlds, agree to 3%."""
    statistics = []
    for worlds in pair(1500):
        rng = np.random.default_rng(1)
        falls, speed, height = 0, 0.0, 0.0
        for _ in range(60):
            worlds.step(rng.uniform(-1, 1, (1500, 2)).astype(np.float32))
            falls += int(worlds["terminated"].sum())
            speed += float(worlds["forward_velocity"].mean()) / 60
            height += float(worlds["features"][:, 0].mean()) / 60
        statistics.append((falls, speed, height))
    assert statistics[0][0] > 1500
    np.testing.assert_allclose(statistics[1], statistics[0], rtol=0.03)


def test_leg_angles_in_every_direction() -> None:
    """The polynomial arctangent against numpy's: what float32 observations can tell, all around."""
    angle = np.linspace(-np.pi, np.pi, 400)
    worlds = Worlds(core_parameters(engine_is_native=True, fall_height=0.0), len(angle))
    for world, value in enumerate(angle):
        worlds.batch.place(world, pose(y=3.0, hip_angle=(value, -value)))
    worlds.batch.observe(worlds["observation"], worlds["features"], worlds["contact"])
    state = worlds.batch.save()
    left = np.where(state[:, 18] == 0, 6, 12)
    rows = np.arange(len(angle))
    dx, dy = state[rows, left] - state[:, 0], state[rows, left + 1] - state[:, 1]
    np.testing.assert_allclose(worlds["observation"][:, 10], np.arctan2(dx, -dy), rtol=0, atol=3e-7)
