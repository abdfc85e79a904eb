"""What stands in the student's place: the presets of `comparison=`, and what their keys do."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from romgrl.artifacts import save_arrays
from romgrl.cli.arguments import faults
from romgrl.cli.config_files import CONF
from romgrl.errors import ArtifactError
from romgrl.gait.features import gait_from_reference
from romgrl.gait.metrics import stride_frequency
from romgrl.provenance.stage_keys import stage_settings
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.wiring.artifact_arrays import read_reference
from romgrl.stages.wiring.imitated import read_imitated
from romgrl.stages.wiring.student_learner import build_discriminator
from tests.conftest import Composer
from tests.helpers.cut_trainings import write_reference

COMPARISONS = sorted(path.stem for path in (CONF / "comparison").glob("*.yaml"))
CHANGED = {
    "last_policy": {"student.kept_policy": "last"},
    "no_resets": {"student.reference_resets": 0.0},
    "no_trunk": {"discriminator.features": "paper"},
    "same_choice": {"eta": 1.0},
    "same_resets": {"eta": 1.0, "student.end_early": False, "student.second_try": False},
    "sinusoid": {"discriminator.imitated": "sinusoid"},
    "student": {},
    "upright": {"eta": 1.0, "student.end_early": False, "student.second_try": False, "student.posture_weight": 0.25},
}
CHANGED["same_resets"] |= {"student.kept_policy": "task_reward"}
CHANGED["upright"] |= {"student.kept_policy": "task_reward"}


@pytest.mark.parametrize("name", COMPARISONS)
def test_a_comparison_changes_the_student_alone(name: str, compose_config: Composer) -> None:
    """By what it is named after, also at a walk; teacher, reference and baseline are those of the student."""
    for experiment in ("quickstart", "walking"):
        config, other = (compose_config(f"experiment={experiment}", f"comparison={each}") for each in (name, "student"))
        assert config.comparison == name
        one, two = (stage_settings("student", each) for each in (config, other))
        assert {key: value for key, value in one.items() if two[key] != value} == CHANGED[name]
        for stage in ("teacher", "reference", "baseline", "evaluation"):
            assert stage_settings(stage, config) == stage_settings(stage, other)


def test_cosines_in_the_place_of_the_reference(compose_config: Composer, tmp_path: Path) -> None:
    """The same cadence and mean, as many episodes; nothing but the first harmonic of the feet."""
    directory = write_reference(tmp_path / "reference")
    config = compose_config("comparison=sinusoid")
    real, made = read_reference(directory, config), read_imitated(directory, config)
    assert read_imitated(directory, compose_config())["features"].tobytes() == real["features"].tobytes()
    gaits = [gait_from_reference(each) for each in (real, made)]
    one, two = (stride_frequency(each.features, each.dt, each.valid) for each in gaits)
    assert two == pytest.approx(one, rel=0.01)
    assert made["features"].mean(0) == pytest.approx(real["features"].mean(0), abs=0.01)
    assert (made["features"].dtype, np.unique(made["episode"]).size) == (np.float32, np.unique(real["episode"]).size)
    foot = made["features"][made["episode"] == 0][:, 1]
    rest = foot[2:] + foot[:-2] - 2 * np.cos(2 * np.pi * two / 30) * foot[1:-1]
    assert np.ptp(rest) < 0.02  # constant for a cosine about its mean


def test_a_reference_that_stands_has_no_cosines(compose_config: Composer, tmp_path: Path) -> None:
    arrays: dict[str, Any] = {"features": np.ones((90, 5), np.float32), "episode": np.zeros(90, np.int32)}
    save_arrays(tmp_path / "reference.npz", arrays | {"dt": 1 / 30, "speed": 4.0})
    with pytest.raises(ArtifactError, match="no strides"):
        read_imitated(tmp_path, compose_config("comparison=sinusoid"))


def test_nothing_is_imitated_where_imitation_has_no_weight(compose_config: Composer, tmp_path: Path) -> None:
    """No discriminator is trained, but episodes begin in the reference and checks compare with it."""
    directory = write_reference(tmp_path / "reference")
    small = ("experiment=smoke", "student.total_steps=600", "student.check_steps=300", "student.reference_resets=1")
    config = compose_config(*small, "comparison=same_choice")
    assert build_discriminator(config, student.window_layout(config), directory) is None
    student.run(config, {"reference": directory}, tmp_path, SilentLog())
    checks = pd.read_csv(tmp_path / "checks.csv")
    assert "error_over_variance" in checks
    assert (checks.eta == 1).all()


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (["comparison=same_resets", "eta=0.5"], "eta: 0.5 is not allowed; allowed: 1.0 with comparison=same_resets"),
        (["comparison=no_trunk", "discriminator.features=trunk"], "discriminator.features: trunk is not allowed; "),
        (["comparison=sinusoid", "student=pretrained"], "comparison: sinusoid is not allowed; allowed: student with "),
        (["comparison=upright", "stage=verify"], "comparison: upright is not allowed; allowed: student with stage="),
    ],
)
def test_a_comparison_is_what_its_name_says(overrides: list[str], line: str) -> None:
    (found,) = faults(overrides)
    assert found.startswith(line)
