"""What a student that follows commands cannot be asked for is refused on one line, before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from romgrl.cli.conditioned_students import conditioned_student
from romgrl.cli.consistency import misfits
from romgrl.config.commanded import conditioned_keys
from romgrl.errors import ConfigurationError
from romgrl.provenance.stage_graph import STAGES
from romgrl.provenance.stage_keys import stage_settings
from romgrl.provenance.taught_cells import too_far
from romgrl.stages import student
from romgrl.stages.conditioned.cells import read_command_cells
from romgrl.stages.conditioned.conditioned_learner import build_conditioned_discriminator
from tests.conftest import Composer
from tests.helpers.commanded import commanded, small_library
from tests.helpers.configurations import with_value


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_library(tmp_path_factory.mktemp("small") / "library")


@pytest.mark.parametrize(
    "override",
    [
        *(f"stage={stage}" for stage in ("robustness", "verify")),
        "student.end_early=true",
        "student.second_try=true",
        "discriminator.imitated=sinusoid",
        "discriminator.reward=stored",
        "discriminator.loss=wasserstein",
    ],
)
def test_what_knows_one_speed_refuses_it_in_one_line(override: str, compose_config: Composer) -> None:
    (line,) = conditioned_student(compose_config("experiment=every_speed", override))
    key, value = override.split("=")
    assert line.startswith(f"{key}: {value} is not allowed; allowed: ")
    assert "with student.kind=conditioned" in line
    assert not [*conditioned_student(compose_config(override))]


@pytest.mark.parametrize(
    ("key", "overrides"),
    [
        ("teacher.speeds", "student=conditioned stage=baseline"),
        ("library.others", "experiment=every_gait library.others=[/no/such/place]"),
        ("library.stiffness_shares", "experiment=every_speed library.stiffness_shares=[0.7,1.2]"),
        (
            "teacher.stiffness_share",
            "student=conditioned stage=student teacher=variable_walking teacher.stiffness_share=0.8",
        ),
        ("library.speed_step", "experiment=every_speed library.speed_step=1e-5"),
        ("student.taught_step", "experiment=every_speed student.taught_step=9"),
        ("student.mismatch_distance", "experiment=every_speed student.mismatch_distance=2"),
    ],
)
def test_a_library_that_cannot_teach_is_refused_before_it_is_made(
    key: str, overrides: str, compose_config: Composer
) -> None:
    (line,) = misfits(compose_config(*overrides.split()))
    assert line.startswith(f"{key}: ")
    assert "is not allowed; allowed: " in line


def test_two_things_that_move_one_weight_are_refused(compose_config: Composer) -> None:
    (line,) = misfits(compose_config("experiment=every_speed", "student.final_eta=0.3", "student.adapt_eta=true"))
    assert line.startswith("student.final_eta: 0.3 is not allowed; allowed: null with student.adapt_eta=true")


@pytest.mark.parametrize("without", ["eta=1", "discriminator.enabled=false"])
def test_no_weight_moves_where_nothing_is_imitated(without: str, compose_config: Composer) -> None:
    config = compose_config("experiment=every_speed", without)
    assert not [*misfits(config)]
    assert stage_settings("student", config)["student.final_eta"] is None
    assert stage_settings("student", compose_config("experiment=every_speed"))["student.final_eta"] == 0.3


def test_what_the_finished_library_refuses_is_refused_before_the_student(
    compose_config: Composer, library: Path
) -> None:
    """It alone says which of the speeds that it was asked for have a fit cell."""
    asked = commanded(compose_config, "stage=export", "speed=9")
    with pytest.raises(ConfigurationError, match=r"^speed: 9.0 is not allowed; allowed: .*run 2 to 4 m/s"):
        STAGES["export"].foresee("library", asked, library)
    STAGES["export"].foresee("library", with_value(asked, "speed", 3.0), library)
    STAGES["export"].foresee("student", asked, library)
    keys = conditioned_keys(asked.student)
    assert not too_far(keys, [("run", 2.0), ("walk", 2.0)])
    assert too_far(keys, [("run", 2.0), ("run", 2.25)]).startswith("student.mismatch_distance: 0.7 is not allowed")
    config = commanded(compose_config, "student.mismatch_distance=5")
    near = read_command_cells(library, config, span=4)
    near.gait[:] = 0
    with pytest.raises(
        ConfigurationError, match=r"^student.mismatch_distance: 5.0 is not allowed; allowed: at most 2 "
    ):
        build_conditioned_discriminator(config, student.window_layout(config), near)
