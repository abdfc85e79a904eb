"""Batches: equal to single worlds, for any thread count, after restoring, in the mirror, and from the same seed."""

import os
import subprocess
import sys

import numpy as np
import pytest

from romgrl.rom import _core
from romgrl.rom.observation import OBSERVATION_NAMES, mirror
from tests.helpers.limits import PATIENCE
from tests.helpers.rom_worlds import FEET, Worlds, core_parameters, pose

pytestmark = pytest.mark.usefixtures("engine")

NUM_WORLDS, STEPS = 37, 150  # three groups of lanes of the native engine
OUTPUTS = ("observation", "reward", "terminated", "final_observation", "features", "reset_features", "contact")


def actions(seed: int = 0, num_worlds: int = NUM_WORLDS, steps: int = STEPS) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, num_worlds, 2)).astype(np.float32)


def record(worlds: Worlds, sequence: np.ndarray) -> dict[str, np.ndarray]:
    frames = []
    for action in sequence:
        worlds.step(np.ascontiguousarray(action))
        frames.append({name: worlds[name].copy() for name in OUTPUTS})
    return {name: np.array([frame[name] for frame in frames]) for name in OUTPUTS}


def seeded(num_threads: int = 1, seed: int = 5, **values: object) -> Worlds:
    worlds = Worlds(core_parameters(**values), NUM_WORLDS, num_threads)
    worlds.batch.seed(seed)
    worlds.batch.reset()
    return worlds


def assert_same_bits(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> None:
    for name in OUTPUTS:
        assert left[name].tobytes() == right[name].tobytes(), name


@pytest.mark.parametrize("num_threads", [2, 3, 11, 64])
def test_thread_count_changes_no_bit(num_threads: int) -> None:
    one = record(seeded(), actions())
    assert one["terminated"].any()  # the comparison goes through autoresets
    assert_same_bits(one, record(seeded(num_threads), actions()))


def test_batch_equals_single_worlds_bit_for_bit() -> None:
    worlds = seeded()
    states, together = worlds.batch.save(), record(worlds, actions())
    for world in range(NUM_WORLDS):
        single = Worlds(core_parameters())
        single.batch.restore(states[world : world + 1])
        alone = record(single, actions()[:, world : world + 1])
        assert_same_bits({name: value[:, world : world + 1].copy() for name, value in together.items()}, alone)


@pytest.mark.parametrize("trunk_locked", [True, False])
def test_restored_state_replays_bit_for_bit(trunk_locked: bool) -> None:
    """Also into worlds with another past, and at every moment of a stride."""
    sequence = actions(1, steps=60)
    for moment in range(0, 20, 3):
        worlds = seeded(trunk_locked=trunk_locked)
        record(worlds, sequence[:moment])
        state = worlds.batch.save()
        first = record(worlds, sequence[moment:])
        worlds.batch.restore(state)
        assert worlds.batch.save().tobytes() == state.tobytes()
        assert_same_bits(first, record(worlds, sequence[moment:]))
        other = seeded(seed=99, trunk_locked=trunk_locked)
        record(other, actions(2, steps=37))
        other.batch.restore(state)
        assert_same_bits(first, record(other, sequence[moment:]))


def test_repeated_steps_in_cpp_equal_steps_from_python() -> None:
    left, right = seeded(2), seeded()
    action = actions(steps=1)[0]
    for _ in range(30):
        left.step(action)
    right.batch.repeat(action, _core.Buffers(right.batch, right.arrays), 30)
    assert left.batch.save().tobytes() == right.batch.save().tobytes()
    assert left["final_observation"].tobytes() == right["final_observation"].tobytes()


def test_seed_repeats_episodes_and_worlds_differ() -> None:
    assert_same_bits(record(seeded(seed=3), actions()), record(seeded(seed=3), actions()))
    state = seeded(seed=3).batch.save()
    assert len(np.unique(state[:, 3])) == NUM_WORLDS  # forward speeds
    assert not np.array_equal(state, seeded(seed=4).batch.save())
    worlds = seeded(seed=3)
    worlds.batch.reset()
    assert not np.array_equal(state[:, :18], worlds.batch.save()[:, :18])  # the next episode


def test_resets_fill_their_ranges() -> None:
    """Hip angles +-U(0.25, 0.40), anti-phase, either side; speed U(0.5, 1.1) of the target; feet on the ground."""
    worlds = Worlds(core_parameters(), 500)
    worlds.batch.seed(0)
    worlds.batch.reset()
    observation, features, contact = worlds["observation"], worlds["features"], worlds["contact"]
    worlds.batch.observe(observation, features, contact)
    angle, speed = observation[:, 10], worlds.batch.save()[:, 3] / 4.0
    np.testing.assert_allclose(observation[:, 11], -angle, atol=1e-5)
    assert 0.25 <= np.abs(angle).min() < 0.26
    assert 0.39 < np.abs(angle).max() <= 0.40 + 1e-6
    assert 0.5 <= speed.min() < 0.52
    assert 1.08 < speed.max() <= 1.1
    assert abs(np.abs(angle).mean() - 0.325) < 0.01
    assert abs((angle > 0).mean() - 0.5) < 0.07
    assert contact.all()
    np.testing.assert_allclose(features[:, 0] + features[:, 2], 0.072, atol=2e-4)
    np.testing.assert_array_equal(observation[:, 19], np.where(angle > 0, 1.0, -1.0))


@pytest.mark.parametrize("trunk_locked", [True, False])
def test_mirrored_worlds_stay_mirror_images(trunk_locked: bool) -> None:
    """Exchanging the legs of the start and of the actions exchanges them ever after, to 1e-5 and in fact exactly."""
    limits = {"fall_height": 0.0, "trunk_pitch_limit": 10.0, "episode_steps": 10**6}
    parameters = core_parameters(trunk_locked=trunk_locked, control_frequency=480.0, substeps=1, **limits)
    left, right = Worlds(parameters, 32), Worlds(parameters, 32)
    rng = np.random.default_rng(7)
    for world in range(32):
        start = {"y": rng.uniform(0.7, 1.0), "vx": rng.uniform(0.0, 5.0), "vy": rng.uniform(-1.0, 1.0)}
        legs = {
            "hip_angle": rng.uniform(-1.2, 1.2, 2),
            "hip_rate": rng.uniform(-15.0, 15.0, 2),
            "leg_length": np.array([0.905, rng.uniform(0.6, 0.9)]),
            "leg_rate": np.array([8.0, rng.uniform(-2.0, 2.0)]),
        }
        left.batch.place(world, pose(**start, **legs))
        right.batch.place(world, pose(**start, **{name: value[::-1] for name, value in legs.items()}))
    mirror_observation = mirror(OBSERVATION_NAMES)
    strain, angle, running = 0.0, 0.0, np.ones(32, bool)
    for action in actions(3, num_worlds=32, steps=400):
        left.step(action)
        right.step(np.ascontiguousarray(action[:, ::-1]))
        running &= ~left["terminated"]  # the next start of a world that fell is not a mirror image
        found, original = right["observation"][running], left["observation"][running]
        np.testing.assert_allclose(found, mirror_observation.image(original), rtol=0, atol=1e-5)
        np.testing.assert_array_equal(right["features"][running], left["features"][running][:, [0, 3, 4, 1, 2]])
        strain, angle = max(strain, float(original[:, 6:8].max())), max(angle, float(np.abs(original[:, 10:12]).max()))
    assert running.sum() > 5
    assert strain > 0.0499  # leg stops were in play,
    assert angle > 1.3  # and hip stops


def test_order_of_the_legs_hardly_matters_to_the_solver() -> None:
    """The same state solved in the other order: 1e-5 m after a control step, with both legs at their stops."""
    worlds = Worlds(core_parameters(fall_height=0.0), 2)
    start = {"y": 1.2, "hip_angle": (0.5, -0.2), "leg_length": (0.9, 0.9), "leg_rate": (4.0, 3.0)}
    for world in range(2):
        worlds.batch.place(world, pose(**start))
    state = worlds.batch.save()
    state[1, 18] = 1.0 - state[1, 18]
    state[1, FEET[0]], state[1, FEET[1]] = state[0, FEET[1]], state[0, FEET[0]]
    worlds.batch.restore(state)
    worlds.step()
    np.testing.assert_allclose(worlds["features"][0], worlds["features"][1], atol=1e-5)


def test_state_size_is_the_modules() -> None:
    assert seeded().batch.save().shape == (NUM_WORLDS, _core.STATE_SIZE)


@pytest.mark.skipif("ROMGRL_SANITIZED" in os.environ, reason="a fork may leave AddressSanitizer's allocator locked")
def test_forked_child_steps_on_without_threads(engine: str) -> None:
    """Worker threads do not survive a fork: the child gives the same numbers alone, and ends without hanging."""
    code = """
import os
import sys
import numpy as np
from tests.helpers.rom_worlds import Worlds, core_parameters
worlds = Worlds(core_parameters(engine_is_native=sys.argv[1] == "native"), 40, 3)
worlds.step()
child = os.fork()
status = 0
for _ in range(5):
    worlds.step()
if child:
    status = os.waitpid(child, 0)[1]
os.write(1, f"{worlds['features'].sum(dtype=np.float64)} ".encode())
del worlds
sys.exit(status)
"""
    result = subprocess.run(
        [sys.executable, "-c", code, engine], capture_output=True, text=True, encoding="utf-8", timeout=PATIENCE
    )
    assert result.returncode == 0, result.stderr
    assert len(set(result.stdout.split())) == 1
    assert len(result.stdout.split()) == 2
