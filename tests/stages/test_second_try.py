"""A student that is lost late in a training makes a part of its steps again, once."""

import math
from pathlib import Path

import pytest

from romgrl.config.schema import Config
from romgrl.stages.training.budget import Budget
from tests.conftest import Composer
from tests.helpers.cut_trainings import Recorder, files, interrupt, train, training
from tests.stages.test_gait_check import GOOD, Learner, checks


@pytest.mark.parametrize(
    ("errors", "passed", "again"),
    [
        ((1.4, 1.4, 1.4, 1.4, 1.4, 1.4), 0, 280),  # at 600 of 1,000 steps it goes back to 320
        ((1.4, 1.4, 1.4, 1.4, 1.4, math.nan), 0, 280),  # falls too often to have an error
        ((1.4, 1.4, 1.4, 1.4, 1.4, 0.9), 0, 0),  # nearer than a statue
        ((1.4, 1.4, 1.4, 0.2, 1.4, 1.4), 1, 0),  # has passed before
    ],
)
def test_a_student_that_is_lost_goes_back_once(
    smoke_config: Config,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    errors: tuple[float, ...],
    passed: int,
    again: int,
) -> None:
    smoke_config.student.second_try, smoke_config.student.adapt_eta = True, False
    wrong = GOOD | {"cadence_error_percent": 17.0, "speed_error_percent": 4.0, "passed": 0.0}
    rows = [wrong | {"error_over_variance": error, "passed": float(passed and error < 1)} for error in errors]
    made = checks(smoke_config, tmp_path, rows + [rows[-1]] * 9, monkeypatch)
    made.teacher = object()
    budget, learner = Budget(1000), Learner(0)
    for step in range(100, 700, 100):
        made.check_if_due(step, learner, budget)
    assert budget.again == again
    assert (learner.eta == 0.25) == bool(again)
    for step in range(700, 1500, 100):
        made.check_if_due(step, learner, budget)
    assert budget.again == again  # not a second time
    for change in ({"second_try": False}, {"minutes": 1.0}):
        for key, value in change.items():
            setattr(smoke_config.student, key, value)
        made = checks(smoke_config, tmp_path, rows, monkeypatch)
        made.teacher = object()
        budget = Budget(1000, smoke_config.student.minutes)
        for step in range(100, 700, 100):
            made.check_if_due(step, Learner(0), budget)
        assert budget.again == 0
        smoke_config.student.second_try = True


def test_a_student_that_is_only_slow_is_not_lost(
    smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its cadence follows from its speed."""
    slow = {"cadence_error_percent": -10.2, "speed_error_percent": -14.5, "passed": 0.0, "error_over_variance": 1.03}
    smoke_config.student.second_try = True
    made = checks(smoke_config, tmp_path, [GOOD | slow] * 6, monkeypatch)
    made.teacher = object()
    budget = Budget(1000)
    for step in range(100, 700, 100):
        made.check_if_due(step, Learner(0), budget)
    assert budget.again == 0


def test_no_check_changes_the_weight_on_a_second_try(
    smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    smoke_config.student.adapt_eta, smoke_config.eta = True, 0.3
    other = GOOD | {"cadence_error_percent": 9.0, "speed_error_percent": 0.0, "error_over_variance": 0.9, "passed": 0.0}
    for again, eta in ((300, 0.35), (0, 0.5)):
        made = checks(smoke_config, tmp_path, [other], monkeypatch)
        made.teacher = object()
        learner = Learner(0)
        made.check_if_due(900, learner, Budget(1000, again=again))
        assert learner.eta == pytest.approx(eta)


def test_a_training_that_goes_back_goes_on_where_it_was_cut(
    compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A student that falls in all episodes at 800 of 1,200 steps makes 416 of them again, interrupted or not."""
    recorder = Recorder(monkeypatch)
    config = training("student", compose_config, "student.total_steps=1200")
    train("student", config, tmp_path / "whole")
    assert recorder.steps[-1] == 1200 + 800 - round(0.32 * 1200)
    whole = (recorder.state, files(tmp_path / "whole"))
    interrupt("student", config, tmp_path / "cut", recorder, 1000)
    train("student", config, tmp_path / "cut")
    assert recorder.steps[0] == 1008
    assert (recorder.state, files(tmp_path / "cut")) == whole
