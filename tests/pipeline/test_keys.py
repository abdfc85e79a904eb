"""Which key of the configuration changes the key of which stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from romgrl.config import Config
from romgrl.keys import STAGES, stage_key
from tests.conftest import Composer

ALL = set(STAGES)
STUDENT = {"student", "evaluation", "report", "robustness"}
BOTH = STUDENT | {"baseline"}
TABLE = {
    "speed=3": BOTH,
    "eta=0.3": STUDENT,
    "noise=0.1": STUDENT,
    "discriminator.learning_rate=1e-3": STUDENT,
    "discriminator=paper": STUDENT,
    "discriminator=none": STUDENT,
    "student.gamma=0.97": BOTH,
    "humanoid.fall_trunk_lean=0.7": BOTH,
    "humanoid.substeps=16": BOTH,
    "humanoid.height=1.6": ALL,
    "humanoid.control_frequency=60": ALL,
    "rom.stiffness=20000": ALL - {"baseline"},
    "teacher.speed=3": ALL - {"baseline"},
    "reference.steps=1000": ALL - {"baseline", "teacher"},
    "evaluation.episodes=8": {"evaluation", "report"},
    "robustness.trials=8": {"robustness"},
    "seed=1": ALL,
    "device=cuda": ALL,
    "threads=1": set(),
    "parallel_stages=false": set(),
    "stage=teacher": set(),
    "tracking=none": set(),
    "tracking.experiment=mine": set(),
    "paths.outputs=/elsewhere": set(),
}


def all_keys(config: Config) -> dict[str, str]:
    """The key of every stage, with the keys of the stages that it reads in the place of their digests."""
    found: dict[str, str] = {}
    for name, stage in STAGES.items():
        found[name] = stage_key(name, config, {upstream: found[upstream] for upstream in stage.upstream})
    return found


@pytest.mark.parametrize("override", TABLE)
def test_which_key_changes_what(compose_config: Composer, override: str) -> None:
    before, after = all_keys(compose_config()), all_keys(compose_config(override))
    assert {stage for stage in STAGES if before[stage] != after[stage]} == TABLE[override]


def different(value: object) -> object:
    """Another value of the same type."""
    if isinstance(value, list):
        return [*value, value[0]]
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return "other" if isinstance(value, str) else 1.0


def test_keys_are_the_same_in_every_process(compose_config: Composer) -> None:
    """Defaults, order of keys and of stages do not enter; two compositions agree."""
    assert all_keys(compose_config("eta=0.5", "seed=0")) == all_keys(compose_config("seed=0", "speed=4"))


def test_no_imitation_makes_noise_and_eta_irrelevant(compose_config: Composer) -> None:
    one = all_keys(compose_config("discriminator=none", "eta=0.2", "noise=0.3"))
    assert one == all_keys(compose_config("discriminator=none"))


def test_a_model_file_counts_by_its_content(compose_config: Composer, tmp_path: Path) -> None:
    config, keys = compose_config(), []
    for name, text in (("a.xml", "<mujoco/>"), ("b.xml", "<mujoco/>"), ("c.xml", "<mujoco></mujoco>")):
        (tmp_path / name).write_text(text, encoding="utf-8")
        keys.append(all_keys(replace(config, humanoid=replace(config.humanoid, xml=str(tmp_path / name)))))
    assert keys[0] == keys[1]
    assert all(keys[0][stage] != keys[2][stage] for stage in STAGES)
