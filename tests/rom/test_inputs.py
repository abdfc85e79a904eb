"""No input may crash the interpreter: bad ones raise ValueError, wild ones end the episode."""

import math
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

from romgrl.config.worlds import SpringLeg
from romgrl.rom import _core
from romgrl.rom.env import SpringLegEnv, VariableLegEnv
from romgrl.rom.parameters import SpringLegParameters
from romgrl.rom.parameters import core_parameters as translated
from romgrl.rom.vector_env import SpringLegVectorEnv
from tests.helpers.limits import PATIENCE
from tests.helpers.rom_worlds import Worlds, core_parameters, pose


@pytest.mark.parametrize(
    "actions",
    [
        np.zeros((3, 2), np.float32),
        np.zeros((4, 3), np.float32),
        np.zeros(8, np.float32),
        np.zeros((4, 2), np.float64),
        np.zeros((4, 2), np.int32),
        np.zeros((4, 2), np.complex64),
        np.zeros((4, 2), object),
        np.zeros((2, 4), np.float32).T,
        np.full((4, 2), np.nan, np.float32),
        np.full((4, 2), np.inf, np.float32),
        np.zeros((0, 2), np.float32),
    ],
)
def test_bad_actions_raise_and_change_nothing(actions: np.ndarray) -> None:
    worlds = Worlds(core_parameters(), 4)
    state = worlds.batch.save()
    with pytest.raises(ValueError, match="actions"):
        worlds.step(actions)
    assert worlds.batch.save().tobytes() == state.tobytes()


@pytest.mark.parametrize("name", list(Worlds(core_parameters(), 4).arrays))
def test_bad_output_arrays_raise(name: str) -> None:
    worlds = Worlds(core_parameters(), 4)
    good = worlds.arrays[name]
    frozen = good.copy()
    frozen.setflags(write=False)
    for bad in (good[:-1].copy(), good.astype(np.float64), np.repeat(good, 2, axis=0)[::2], frozen):
        worlds.arrays[name] = bad
        with pytest.raises(ValueError, match=name):
            worlds.step()


def test_buffers_of_another_batch_raise() -> None:
    worlds, other = Worlds(core_parameters(), 4), Worlds(core_parameters(), 5)
    with pytest.raises(ValueError, match="another batch"):
        worlds.batch.step(np.zeros((4, 2), np.float32), _core.Buffers(other.batch, other.arrays))
    with pytest.raises(KeyError):
        _core.Buffers(worlds.batch, {})


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("mass", (0.0, -1.0, 1.4, math.nan, math.inf)),
        ("leg_length", (0.0, -0.5, 3.0, math.nan)),
        ("foot_radius", (0.0, -1.0, math.nan)),
        ("foot_mass", (0.0, 36.0, math.nan, 1e-3)),
        ("stiffness", (0.0, -1.0, math.nan, 1e7)),
        ("swing_damping", (-1.0, math.nan, 2000.0)),
        ("hip_torque", (-1.0, math.nan, math.inf)),
        ("torque_lag", (-0.1, math.nan)),
        ("trunk_moment_limit", (-1.0, math.nan)),
        ("retraction", (-0.1, 0.5, math.nan)),
        ("retraction_time", (0.0, math.nan)),
        ("hip_angle_limit", (0.0, 2.0, math.nan)),
        ("compression_limit", (0.0, 1.1, math.nan)),
        ("extension_limit", (0.9, 2.1, math.nan)),
        ("friction", (-1.0, math.nan)),
        ("trunk_inertia", (0.0, -1.0, math.nan)),
        ("fall_height", (-0.1, 1.1, math.nan)),
        ("substeps", (0, -1, 1_000_000, 1.5, "16")),
        ("velocity_iterations", (0, -5)),
        ("position_iterations", (0, -5)),
        ("reset_hip_angle", ((0.4, 0.2), (0.1, 2.0), (math.nan, 0.3), (0.1,))),
        ("reset_speed", ((1.0, 0.5), (0.0, math.nan))),
        ("observation", ("half", None)),
        ("engine", ("bullet", None)),
    ],
)
def test_bad_parameters_raise(name: str, values: tuple[object, ...]) -> None:
    for value in values:
        parameters = SpringLegParameters(**{name: value})
        with pytest.raises(ValueError, match=r".+"):
            SpringLegVectorEnv(parameters=parameters, num_envs=2)


@pytest.mark.parametrize("name", ["reset_speed", "reset_hip_angle"])
@pytest.mark.parametrize("value", [(1,), (0.3, 0.4, 0.5), 3, None, (0.3, "x")])
def test_a_range_that_is_none_is_named(name: str, value: object) -> None:
    parameters = SpringLegParameters(**{name: value})
    with pytest.raises(ValueError, match=f"^{name}"):
        SpringLegVectorEnv(parameters=parameters)


def test_parameters_of_another_type_are_named() -> None:
    for value in ({}, {"mass": 70.0}, 3):
        with pytest.raises(ValueError, match=r"^parameters are .*, not SpringLegParameters$"):
            SpringLegVectorEnv(parameters=value)


@pytest.mark.parametrize("speed", [-1.0, 11, math.nan])
def test_a_speed_is_told_by_the_name_that_it_was_given_by(speed: float) -> None:
    with pytest.raises(ValueError, match=r"^speed = .* is not between 0 and 10$"):
        SpringLegEnv(speed=speed)


def test_legs_with_motors_are_not_without_them() -> None:
    with pytest.raises(ValueError, match=r"^parameters are SpringLegParameters, not VariableLegParameters$"):
        VariableLegEnv(parameters=SpringLegParameters())
    assert VariableLegEnv().parameters.engine == "native"


@pytest.mark.parametrize("make", [SpringLegVectorEnv, SpringLegEnv])
def test_options_of_a_reset_are_refused_and_change_nothing(make: type[SpringLegVectorEnv] | type[SpringLegEnv]) -> None:
    env, other = make(), make()
    for of in (env, other):
        of.reset(seed=0)
    with pytest.raises(ValueError, match=r"^options .*reset_mask.* are not supported"):
        env.reset(seed=1, options={"reset_mask": np.array([True])})
    assert np.array_equal(env.reset(options={})[0], other.reset()[0])


@pytest.mark.parametrize(
    "arguments",
    [
        {"num_envs": 0},
        {"num_envs": -1},
        {"num_threads": 0},
        {"speed": math.nan},
        {"speed": -1.0},
        {"control_frequency": 0.0},
        {"control_frequency": math.nan},
        {"episode_steps": 0},
        {"alpha": 0.0},
        {"reward": "distance"},
        {"render_mode": "human"},
    ],
)
def test_bad_arguments_raise(arguments: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r".+"):
        SpringLegVectorEnv(**arguments)


@pytest.mark.usefixtures("engine")
def test_bad_poses_and_states_raise_and_change_nothing() -> None:
    worlds = Worlds(core_parameters(), 2)
    before = worlds.batch.save()
    for bad in ({"y": math.nan}, {"vx": math.inf}, {"hip_angle": (0.0, math.nan)}, {"leg_length": (0.0, 1.0)}):
        with pytest.raises(ValueError, match="pose"):
            worlds.batch.place(0, pose(**bad))
    for world in (-1, 2):
        with pytest.raises(ValueError, match="no world"):
            worlds.batch.place(world, pose())
    for column in range(_core.STATE_SIZE):
        for value in (math.nan, math.inf):
            state = before.copy()
            state[1, column] = value
            with pytest.raises(ValueError, match="not a saved state"):
                worlds.batch.restore(state)
    with pytest.raises(ValueError, match="states"):
        worlds.batch.restore(before[:1])
    assert worlds.batch.save().tobytes() == before.tobytes()


@pytest.mark.usefixtures("engine")
def test_what_can_be_restored_is_finite_or_has_diverged() -> None:
    worlds = Worlds(core_parameters(), 1)
    before = worlds.batch.save()
    refused = dict.fromkeys(range(_core.STATE_SIZE), 0)
    for column in refused:
        for value in (1e308, -1e308, 1e12, -1e12, 1e6):
            state = before.copy()
            state[0, column] = value
            try:
                worlds.batch.restore(state)
            except ValueError:
                refused[column] += 1
                continue
            worlds.batch.observe(*(worlds[name] for name in ("observation", "features", "contact")))
            assert np.isfinite(worlds["observation"]).all(), (column, value)
            worlds.step()
            for name in ("observation", "final_observation", "forward_velocity", "reward"):
                assert np.isfinite(worlds[name]).all(), (column, value, name)
    assert refused[19] == refused[20] == 4


@pytest.mark.usefixtures("engine")
def test_wild_states_end_the_episode_with_finite_numbers() -> None:
    """Velocities beyond all reason: the world is flagged, reset, and its neighbour goes on."""
    worlds = Worlds(core_parameters(), 2)
    wild = {"y": 900.0, "vx": 900.0, "vy": 999.0, "hip_rate": (-99.0, 99.0), "leg_length": (0.01, 0.4)}
    worlds.batch.place(0, pose(**wild))
    worlds.step(np.ones((2, 2), np.float32))
    assert worlds["diverged"].tolist() == [True, False]
    assert worlds["terminated"][0]
    for name in ("observation", "final_observation", "features", "reset_features", "reward", "ground_force"):
        assert np.isfinite(worlds[name]).all(), name
    for _ in range(50):
        worlds.step(np.ones((2, 2), np.float32))
        assert not worlds["diverged"].any()


def test_random_poses_and_parameters_never_crash(engine: str) -> None:
    """In a process of its own, since a failed assertion of Box2D would end it."""
    code = """
import sys
import numpy as np
from romgrl.config.worlds import SpringLeg
from romgrl.rom import _core
from romgrl.rom.env import SpringLegEnv
from tests.helpers.rom_worlds import Worlds, core_parameters, pose
rng = np.random.default_rng(0)
wild = lambda *size: rng.choice([-1e300, -1e9, -999.0, -1.0, 0.0, 1e-300, 0.5, 3.0, 999.0, 1e9, np.nan, np.inf], size)
refused = stepped = 0
native = sys.argv[1] == "native"
for trial in range(400):
    names = rng.choice(["stiffness", "foot_mass", "mass", "leg_length", "friction", "hip_torque", "trunk_inertia"], 2)
    values = {str(name): float(10.0 ** rng.uniform(-6, 8)) for name in names} if trial % 2 else {}
    try:
        worlds = Worlds(core_parameters(engine_is_native=native, trunk_locked=bool(trial % 3), **values), 3)
        numbers = [float(value) for value in rng.choice([0.5, 1.0, 900.0, -900.0, 10.0], 4)]
        if trial % 5 == 0:
            numbers = [float(value) for value in wild(4)]
        worlds.batch.place(0, pose(y=numbers[0], vx=numbers[1], hip_rate=numbers[2:], leg_rate=numbers[2:]))
        for _ in range(5):
            worlds.step(rng.uniform(-5, 5, (3, 2)).astype(np.float32))
            assert np.isfinite(worlds["final_observation"]).all() and np.isfinite(worlds["observation"]).all()
        stepped += 1
    except ValueError:
        refused += 1
print(refused, stepped)
"""
    result = subprocess.run(
        [sys.executable, "-c", code, engine], capture_output=True, text=True, encoding="utf-8", timeout=PATIENCE
    )
    assert result.returncode == 0, result.stderr
    refused, stepped = map(int, result.stdout.split())
    assert refused > 50
    assert stepped > 100


def test_the_schema_has_the_bounds_of_the_core() -> None:
    """So that what is refused on the command line and what the core refuses are the same."""
    compared = 0
    for entry in fields(SpringLeg):
        if entry.name in _core.PARAMETERS and entry.type != "bool":
            _, least, most = _core.PARAMETERS[entry.name]
            low, high, above = (entry.metadata[name] for name in ("low", "high", "above"))
            assert (above if low is None else low, math.inf if high is None else high) == (least, most), entry.name
            compared += 1
    assert compared == 23


def test_the_defaults_stand_in_the_core_alone() -> None:
    """Also those of the ranges of resets, which are no rows of the core's table."""
    own = translated(
        SpringLegParameters(), speed=4.0, control_frequency=30.0, episode_steps=400, reward="exponential", alpha=1.0
    )
    resets = [f"reset_{name}_{end}" for name in ("hip_angle", "speed") for end in ("low", "high")]
    for name in [*_core.PARAMETERS, *resets]:
        assert getattr(own, name) == getattr(_core.Parameters(), name), name
