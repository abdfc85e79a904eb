"""PPO whose episodes begin on cycles that CMA-ES has found: the bank, the training, the key, and what is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from romgrl.artifacts import save_tensors
from romgrl.cli.arguments import faults
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError, ConfigurationError
from romgrl.provenance.stage_keys import stage_key, stage_settings
from romgrl.rom import _core
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages.training import cycle_bank
from romgrl.stages.training.cycle_bank import fill_bank
from romgrl.stages.wiring.rom import rom_env
from tests.conftest import Composer
from tests.helpers.cut_trainings import Recorder, files, interrupt, train, training
from tests.helpers.cycles import write_cycles

WALK = ("rom=variable_walking", "teacher.gait=walk", "teacher.speed=1", "teacher.stiffness_share=1")
SPEED, ROW = _core.WALKER_SIZE + 4, 22


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A controller that was never searched for stands for some steps."""
    for name, value in {"WORLDS": 24, "SETTLED": 3, "KEPT": 3, "APART": 2}.items():
        monkeypatch.setattr(cycle_bank, name, value)


@pytest.fixture
def cycles(compose_config: Composer, tmp_path: Path) -> Path:
    """A teacher for walks from 0.75 to 1.5 m/s."""
    write_cycles(tmp_path / "cycles", compose_config("teacher=variable_walking", "threads=1"))
    return tmp_path / "cycles"


def asking(path: Path, *more: str, share: float = 0.5) -> tuple[str, ...]:
    return ("teacher=ppo", *WALK, f"teacher.cycles={path}", f"teacher.cycle_resets={share}", *more)


def banked(config: Config) -> tuple[np.ndarray, np.ndarray]:
    """The states of the bank, and the worlds of a training that begin there."""
    env = rom_env(config, num_envs=200, episode_steps=50, training=True)
    bank = fill_bank(config, env, SilentLog())
    env.reset(seed=1)
    return bank.states, env.save()


def test_the_bank_holds_worlds_that_stand_at_what_both_teachers_learn(compose_config: Composer, cycles: Path) -> None:
    states, _ = banked(compose_config(*asking(cycles, "threads=1", share=1)))
    assert len(states) % 3 == 0
    assert len(states) > 3 * 12
    assert (states[:, SPEED] == 1.0).all()
    assert (states[:, ROW] == 1.0).all()
    assert states[:, 1].min() > 0.6 * 0.8  # above the height of a fall
    assert len(np.unique(states[:, 1])) == len(states)
    wide = compose_config(*asking(cycles, "threads=2", "teacher.speeds=[1,3]", "teacher.command_steps=20", share=1))
    states, worlds = banked(wide)
    for rows in (states, worlds):
        assert 1.0 <= rows[:, SPEED].min() < 1.05
        assert 1.45 < rows[:, SPEED].max() <= 1.5
    again, _ = banked(replace(wide, threads=1))
    np.testing.assert_array_equal(states, again)
    other, _ = banked(replace(wide, seed=1))
    assert not np.array_equal(states, other)


def test_a_controller_that_falls_everywhere_has_no_cycles(
    compose_config: Composer, cycles: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cycle_bank, "SETTLED", 450)
    line = f"^teacher.cycles: {cycles} is not allowed; allowed: a teacher that does not fall in all of 24 episodes"
    with pytest.raises(ConfigurationError, match=line):
        banked(compose_config(*asking(cycles, "threads=1")))


def test_a_training_draws_from_the_bank_and_goes_on_bit_for_bit(
    compose_config: Composer, cycles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(monkeypatch)
    short, ends = ("teacher.total_steps=2048", "teacher.check_steps=0"), {}
    for name, more in {"plain": ("teacher=ppo", *WALK), "whole": asking(cycles)}.items():
        recorder.again()
        train("teacher", training("teacher", compose_config, *more, *short), tmp_path / name)
        ends[name] = (recorder.state, files(tmp_path / name))
    assert ends["plain"][1] != ends["whole"][1]
    config = training("teacher", compose_config, *asking(cycles), *short)
    interrupt("teacher", config, tmp_path / "cut", recorder, 1000)
    train("teacher", config, tmp_path / "cut")
    assert (recorder.state, files(tmp_path / "cut")) == ends["whole"]


def test_its_key_is_that_of_the_contents_wherever_they_lie(compose_config: Composer, cycles: Path) -> None:
    def key(path: Path | None) -> str:
        return stage_key("teacher", compose_config(*(asking(path) if path else ("teacher=ppo", *WALK))), {})

    moved = Path(shutil.copytree(cycles, cycles.parent / "moved"))
    other = cycles.parent / "other"
    manifest = write_cycles(other, compose_config("teacher=variable_walking"), move=0.01)
    assert key(cycles) == key(moved)
    assert len({key(None), key(cycles), key(other)}) == 3
    settings = stage_settings("teacher", compose_config(*asking(other)))
    assert settings["teacher.cycles"] == f"{manifest.key} sha256:{manifest.digest}"
    assert stage_settings("teacher", compose_config("teacher=ppo"))["teacher.cycles"] is None
    (other / "policy.safetensors").write_bytes(b"damaged")
    with pytest.raises(ArtifactError, match=r"policy.safetensors: does not have the SHA-256 of its manifest"):
        key(other)


def test_a_teacher_that_fell_in_each_of_its_checks_is_refused_before_any_work(
    compose_config: Composer, tmp_path: Path
) -> None:
    walking = compose_config("teacher=variable_walking")
    for name, falls in {"fell": (100, 100), "stood": (100, 99)}.items():
        rows = "".join(f"teacher at {speed} m/s,100,{fell}\n" for speed, fell in zip((0.75, 1.5), falls, strict=True))
        write_cycles(tmp_path / name, walking, gaits=f"walker,episodes,falls\n{rows}")
    (line,) = faults([*asking(tmp_path / "fell")])
    assert line.startswith(f"teacher.cycles: {tmp_path / 'fell'} is not allowed; allowed: a teacher that stands in an ")
    assert faults([*asking(tmp_path / "stood")]) == []


def test_what_does_not_fit_gets_one_line(compose_config: Composer, cycles: Path, tmp_path: Path) -> None:
    """Each time the key, the path, and what is allowed."""
    walking = compose_config("teacher=variable_walking")
    shipped = Path(cycle_bank.__file__).parents[2] / "pretrained" / "teacher"
    damaged = Path(shutil.copytree(cycles, tmp_path / "damaged"))
    save_tensors(damaged / "policy.safetensors", {}, {})
    write_cycles(tmp_path / "soft", walking, rom__stiffness=9e3, humanoid__mass=60.0)
    write_cycles(tmp_path / "hop", walking, teacher__gait="hop")
    write_cycles(tmp_path / "old", walking, rom__no_key=1)
    (tmp_path / "file").write_text("text", encoding="utf-8")
    finished = "the directory of a teacher's finished artifact ("
    same = "a teacher by cmaes of the same rom and gait (it has "
    for path, more, line in (
        (Path("/no/such/place"), (), f"{finished}/no/such/place/manifest.json: missing"),
        (tmp_path, (), f"{finished}{tmp_path}/manifest.json: missing"),
        (tmp_path / "file", (), f"{finished}{tmp_path}/file/manifest.json: missing"),
        (damaged, (), f"{finished}{damaged}/policy.safetensors: does not have the SHA-256"),
        (shipped, (), f"{same}"),
        (tmp_path / "soft", (), f"{same}humanoid.mass 60.0 instead of 71.8, rom.stiffness 9000.0 instead of 16000.0)"),
        (tmp_path / "hop", (), f"{same}teacher.gait hop instead of walk)"),
        (cycles, ("rom.friction=0.5",), f"{same}rom.friction 1.0 instead of 0.5)"),
        (cycles, ("teacher.speed=2",), "a teacher whose teacher.speeds meet 2.0 (it has [0.75, 1.5])"),
        (cycles, ("teacher.stiffness_share=0.8",), "a teacher whose teacher.stiffness_shares meet 0.8 (it has 1.0)"),
        (cycles, ("teacher.pretrained=true",), "null with teacher.pretrained=true"),
    ):
        found = [each for each in faults([*asking(path, *more)]) if each.startswith("teacher.cycles: ")]
        assert len(found) == 1, (path, more, faults([*asking(path, *more)]))
        assert found[0].startswith(f"teacher.cycles: {path} is not allowed; allowed: {line}"[:200]), found[0]
    (line,) = faults([*asking(tmp_path / ("x" * 300))])
    assert line.endswith(f" is not allowed; allowed: {finished}File name too long)")
    assert faults([*asking(tmp_path / "old")]) == []
    assert len(faults([*asking(Path("/no/such/place"), share=0.0)])) == 1
    assert faults([*asking(cycles, "teacher.speeds=[0.5,1]")]) == []
    for share, path, line in ((0.0, cycles, "more than 0 with"), (0.5, "null", "0 without")):
        (found_line,) = faults([*asking(Path(path), share=share)])
        said = f"teacher.cycle_resets: {share} is not allowed; allowed: {line} teacher.cycles"
        assert found_line == said
