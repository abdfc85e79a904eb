"""Random points of a sweep: uniform, the same whenever they are asked for, and a misuse is one line."""

from __future__ import annotations

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from scipy.stats import kstest

from romgrl.cli.compose import to_config
from romgrl.cli.config_files import CONF
from romgrl.cli.consistency import validate
from romgrl.cli.search_space import random_value
from romgrl.config.schema import Config
from tests.conftest import Composer
from tests.helpers.jobs import ROOT, Command


def test_a_point_is_fixed_by_seed_and_name() -> None:
    assert random_value(3, "stiffness", 0.0, 1.0) == random_value(3, "stiffness", 0.0, 1.0)
    assert len({random_value(seed, name, 0.0, 1.0) for seed in range(5) for name in ("a", "b")}) == 10


def test_points_are_uniform_and_log_points_are_uniform_in_the_logarithm() -> None:
    linear = np.array([random_value(seed, "x", 2.0, 5.0) for seed in range(400)])
    log = np.array([random_value(seed, "x", 8e3, 32e3, "log") for seed in range(400)])
    assert kstest((linear - 2.0) / 3.0, "uniform").pvalue > 0.01
    assert kstest(np.log(log / 8e3) / np.log(4.0), "uniform").pvalue > 0.01
    assert log.min() >= 8e3
    assert log.max() <= 32e3


@pytest.mark.parametrize("bad", [(1.0, 1.0, "linear"), (2.0, 1.0, "linear"), (0.0, 1.0, "log"), (0.0, 1.0, "cubic")])
def test_what_cannot_be_drawn(bad: tuple[float, float, str]) -> None:
    with pytest.raises(ValueError, match="draw needs"):
        random_value(0, "x", *bad)


def test_a_configuration_may_draw(compose_config: Composer) -> None:
    def composed(seed: int) -> Config:
        return compose_config(f"seed={seed}", "rom.stiffness='${draw:${seed},stiffness,8e3,32e3,log}'")

    assert composed(5).rom.stiffness == composed(5).rom.stiffness == random_value(5, "stiffness", 8e3, 32e3, "log")
    assert composed(5).rom.stiffness != composed(6).rom.stiffness
    assert composed(5).rom.foot_mass == composed(6).rom.foot_mass


def test_a_bad_draw_is_told_on_one_line(command: Command) -> None:
    result = command("rom.stiffness='${draw:0,x,5,1}'")
    assert result.returncode == 2
    assert result.stderr.startswith("rom.stiffness: ")
    assert "draw needs low < high" in result.stderr
    assert "Traceback" not in result.stderr


def test_points_of_the_stored_search_are_valid(compose_config: Composer) -> None:
    """The points lie where the model can be integrated, and no two are the same."""
    compose_config()
    points = set()
    with initialize_config_dir(str(ROOT / "sweeps"), version_base="1.3"):
        for seed in (0, 17, 39):
            overrides = [f"hydra.searchpath=[file://{CONF}]", f"seed={seed}", "teacher.speed=1.0"]
            config = to_config(compose("teacher", overrides=overrides))
            validate(config)
            points.add(config.rom.stiffness)
    assert len(points) == 3
