"""Presets of one's own: their names, and the line that says where their keys go."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.cli.arguments import faults
from romgrl.cli.config_files import CONF
from romgrl.config.schema import PRESETS
from tests.cli.loading import composed


def test_a_preset_without_a_name_has_that_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text("# @package _global_\nspeed: 3\n", encoding="utf-8")
    arguments = (f"--config-dir={tmp_path}", "experiment=mine")
    config, lines = composed(*arguments).compose(arguments[1:])
    assert config is not None, lines
    assert (config.experiment, config.speed) == ("mine", 3)
    assert faults(arguments) == []


MINE = {
    "rom": ("spring_leg", "stiffness: 20000.0"),
    "teacher": ("ppo", "alpha: 2.0"),
    "humanoid": ("planar", "mass: 80.0"),
    "student": ("sac", "gamma: 0.95"),
    "discriminator": ("paper", "window: 2"),
    "evaluation": ("quick", "episodes: 8"),
    "tracking": ("none", "experiment: mine"),
}


def test_a_choice_of_ones_own_in_every_group(tmp_path: Path) -> None:
    """It needs no name, and nobody has to allow it."""
    for group, (base, line) in MINE.items():
        (tmp_path / group).mkdir()
        text = f"defaults: [{base}, _self_]\n{line}\n"
        (tmp_path / group / "mine.yaml").write_text(text, encoding="utf-8")
    choices = [f"{group}=mine" for group in MINE]
    assert faults([f"--config-dir={tmp_path}", *choices]) == []
    config, lines = composed(f"--config-dir={tmp_path}").compose(choices)
    assert config is not None, lines
    for group, (_, line) in MINE.items():
        key, _, value = line.partition(": ")
        assert str(config[group][key]) == value
        assert config[group].get("name", "mine") == "mine"
    groups = {path.name for path in CONF.iterdir() if path.is_dir()} - {*PRESETS, "hydra"}
    assert groups == MINE.keys()


HEADERS = {
    "# mine\n# @package _global_\n": ":2: # @package _global_ does not count: line 1 stands above it; make it",
    "\ufeff# @package _global_\n": ":1: # @package _global_ does not count: the file starts with a byte order mark",
    "experiment: mine\n\n#@package _global_\n": ":3: #@package _global_ does not count: line 1 stands above it",
    "# @package: _global_\n": ":1: # @package: _global_ does not count: write `# @package NAME`",
    "# @package _global_ # mine\n": ": Too many components in '@package _global_ # mine'; write `# @package",
}


@pytest.mark.parametrize("header", HEADERS)
def test_a_package_that_does_not_count_is_named(tmp_path: Path, header: str) -> None:
    path = tmp_path / "experiment" / "mine.yaml"
    path.parent.mkdir()
    path.write_text(header + "speed: 3\n", encoding="utf-8")
    lines = faults([f"--config-dir={tmp_path}", "experiment=mine", "eta=7"])
    assert [line for line in lines if line.startswith(f"{path}{HEADERS[header]}")], lines
    assert len(lines) == 2  # eta is told, too


def test_a_package_that_counts(tmp_path: Path) -> None:
    path = tmp_path / "experiment" / "mine.yaml"
    path.parent.mkdir()
    path.write_text("\n# @package _global_\n# mine\nexperiment: mine\nspeed: 3\n", encoding="utf-8")
    assert faults([f"--config-dir={tmp_path}", "experiment=mine"]) == []
    path.write_text("speed: 3\n", encoding="utf-8")
    (line,) = faults([f"--config-dir={tmp_path}", "experiment=mine"])
    assert line.endswith("; the first line of a preset is `# @package _global_`")
