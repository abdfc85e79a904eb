"""Every reduced-order model keeps the interface, and one of other mechanics needs its record and its keys alone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from romgrl.artifacts import load_arrays
from romgrl.cli.compose import branches, compose_config, conf_loader, register_schema, store_schema
from romgrl.cli.consistency import misfits
from romgrl.config import values, worlds
from romgrl.errors import ConfigurationError
from romgrl.rom import registry
from romgrl.rom.interface import RomVectorEnv
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import reference, teacher
from romgrl.stages.wiring.rom import rom_env
from tests.helpers.pedal import PEDAL, Pedal

MODELS = registry.MODELS | {"pedal": PEDAL}


@pytest.fixture
def pedal(tmp_path: Path) -> Iterator[tuple[str, ...]]:
    """The other model in both registries, and a preset of it; yields the overrides that choose it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(registry.MODELS, "pedal", PEDAL)
        patch.setitem(worlds.ROMS, "pedal", Pedal)
        forget_schema()
        (tmp_path / "rom").mkdir()
        preset = "model: pedal\nmass: null\nleg_length: null\nfoot_radius: null\ncrank: 0.3\ndrive: 20.0\n"
        (tmp_path / "rom" / "pedal.yaml").write_text(preset, encoding="utf-8")
        yield f"hydra.searchpath=[file://{tmp_path}]", "rom=pedal"
    forget_schema()
    register_schema()


def forget_schema() -> None:
    """All that a process keeps of the keys, lest another test find those of this one."""
    for kept in (values.schema_keys, branches, store_schema, conf_loader):
        kept.cache_clear()


def worlds_of(name: str, num_envs: int = 4, episode_steps: int = 30) -> RomVectorEnv:
    model = MODELS[name]
    task: dict[str, Any] = {"speed": 2.0, "control_frequency": 30.0, "reward": "exponential", "alpha": 1.0}
    return model.worlds(parameters=model.parameters(), num_envs=num_envs, episode_steps=episode_steps, **task)


def random_actions(env: RomVectorEnv, steps: int) -> list[Any]:
    size = env.single_action_space.shape[0]
    draw = np.random.default_rng(0)
    return [draw.uniform(-1, 1, (env.num_envs, size)).astype(np.float32) for _ in range(steps)]


def test_the_keys_of_every_model_are_known() -> None:
    assert registry.MODELS.keys() == worlds.ROMS.keys()
    for name, model in registry.MODELS.items():
        own = {key for key in vars(worlds.ROMS[name])["__dataclass_fields__"] if key not in ("name", "model")}
        assert own == set(vars(model.parameters())), name


@pytest.mark.parametrize("name", MODELS)
def test_names_mirrors_and_infos(name: str) -> None:
    env = worlds_of(name)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (4, len(env.observation_names))
    assert observation.dtype == np.float32
    seen = env.mirror_observation.image(observation)
    np.testing.assert_array_equal(env.mirror_observation.image(seen), observation)
    *_, info = env.step(random_actions(env, 1)[0])
    shapes = {"features": (4, 5), "forward_velocity": (4,), "contact": (4, 2), "diverged": (4,)}
    assert {key: info[key].shape for key in shapes} == shapes
    assert info["final_obs"].shape == observation.shape
    env.close()


@pytest.mark.parametrize("name", MODELS)
def test_the_same_seed_gives_the_same_bits_and_a_saved_state_goes_on(name: str) -> None:
    one, other = worlds_of(name), worlds_of(name)
    actions = random_actions(one, 40)  # past a reset
    one.reset(seed=3)
    first = [tuple(map(np.copy, one.step(action)[:4])) for action in actions]
    other.reset(seed=3)
    for action in actions[:10]:
        other.step(action)
    kept = other.save()
    for action in actions[:7]:
        other.step(action)
    other.restore(kept)
    for step in range(10, 40):
        for found, expected in zip(other.step(actions[step])[:4], first[step], strict=True):
            np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match="shape"):
        other.restore(kept[:2])


def test_another_model_has_its_own_keys(pedal: tuple[str, ...]) -> None:
    config = compose_config(*pedal)
    assert isinstance(config.rom, Pedal)
    assert (config.rom.name, config.rom.model, config.rom.crank) == ("pedal", "pedal", 0.3)
    assert {key for key in values.keys_of(config) if key.startswith("rom.")} == {
        "rom.name", "rom.model", "rom.mass", "rom.leg_length", "rom.foot_radius", "rom.crank", "rom.drive"
    }  # fmt: skip
    assert isinstance(compose_config().rom, worlds.SpringLeg)
    assert [*misfits(compose_config(*pedal, "rom.crank=0.4"))] == []
    line = "rom.crank: {} is not allowed; allowed: at most half of rom.leg_length"
    assert [*misfits(compose_config(*pedal, "rom.leg_length=0.5"))] == [line.format(0.3)]
    short = compose_config(*pedal, "rom.crank=0.4", "humanoid.height=1.4")  # whose leg it is where that is null
    with pytest.raises(ConfigurationError, match=re.escape(line.format(0.4))):
        rom_env(short, num_envs=1, episode_steps=1)
    for value, usual in (("speeds=[1,5]", "null"), ("work_cost=0.1", "0.0"), ("stiffness_share=0.9", "1.0")):
        (line,) = misfits(compose_config(*pedal, f"teacher.{value}"))
        assert line.startswith(f"teacher.{value.partition('=')[0]}: ")
        assert line.endswith(f"allowed: {usual} with rom.model=pedal")


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("rom.stiffness=3", "rom.stiffness: rom.model=pedal has no such key"),
        ("rom.trunk_moment_limit=null", "rom.trunk_moment_limit: rom.model=pedal has no such key"),
        (
            "rom.stiffness=${nothing}",
            "rom.stiffness: ${nothing} cannot be resolved",
        ),
        ("rom.model=${nothing}", "rom.model: ${nothing} cannot be resolved"),
        ("rom.crank=-1", "rom.crank: -1 is not allowed; allowed: a number >= 0.01 and <= 0.4 m"),
        ("rom.model=wheel", "rom.model: wheel is not allowed; allowed: spring_leg, variable_leg, pedal"),
    ],
)
def test_a_key_of_another_model_is_refused(pedal: tuple[str, ...], override: str, line: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        compose_config(*pedal, override)
    assert any(found.startswith(line) for found in str(error.value).splitlines())


@pytest.mark.parametrize("model", ["null", "[pedal]", "3", "{a:1}"])
def test_a_model_that_is_none_gets_one_line(pedal: tuple[str, ...], model: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        compose_config(*pedal, f"rom.model={model}")
    (line,) = str(error.value).splitlines()
    assert line.startswith("rom.model: ")
    assert "; allowed: spring_leg, variable_leg, pedal" in line


def test_a_model_on_the_preset_of_another_gets_one_line(pedal: tuple[str, ...]) -> None:
    with pytest.raises(ConfigurationError) as error:
        compose_config(pedal[0], "rom.model=pedal")
    (line,) = str(error.value).splitlines()
    assert line.startswith("rom.model: pedal does not go with the rest of `rom`, which has rom.foot_mass and others")


@pytest.mark.parametrize("walker", ["teacher", "student"])
def test_what_ships_walks_on_its_own_model_alone(pedal: tuple[str, ...], walker: str) -> None:
    lines = [*misfits(compose_config(f"{walker}=pretrained", *pedal))]
    assert "rom.model: pedal is not allowed; allowed: spring_leg, as the pretrained teacher was trained" in lines


def test_a_teacher_walks_on_another_model(pedal: tuple[str, ...], tmp_path: Path) -> None:
    smoke = compose_config(*pedal, "experiment=smoke", "reference.check=false")
    (tmp_path / "teacher").mkdir()
    (tmp_path / "reference").mkdir()
    teacher.run(smoke, {}, tmp_path / "teacher", SilentLog())
    reference.run(smoke, {"teacher": tmp_path / "teacher"}, tmp_path / "reference", SilentLog())
    features = load_arrays(tmp_path / "reference" / "reference.npz")["features"]
    assert features.shape == (smoke.reference.steps, 5)
    np.testing.assert_allclose(features[:, 1], -features[:, 3], atol=1e-6)  # feet on one crank
