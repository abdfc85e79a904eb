"""A training by minutes: when it ends, what its learning rates and checks follow, and how it goes on."""

from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from romgrl.artifacts.checkpoint import CHECKPOINT
from romgrl.cli.arguments import faults
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.training import budget as budget_module
from romgrl.stages.training import gait_check
from romgrl.stages.training.budget import Budget, over_the_middle
from tests.conftest import Composer
from tests.helpers.cut_trainings import Recorder, files, interrupt, train, training

BY_MINUTES = ("student.minutes=2.5", "student.total_steps=1e9")  # 150 passes of 8 humanoids, with the clock below


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second passes from one reading to the next."""
    ticks = count(1000.0)
    monkeypatch.setattr(budget_module, "time", SimpleNamespace(monotonic=lambda: next(ticks)))


def test_what_moves_over_the_middle_half_stays_before_and_after() -> None:
    shares = (0.0, 0.25, 0.5, 0.75, 1.0)
    assert [over_the_middle(0.5, 1.5, share) for share in shares] == [0.5, 0.5, 1.0, 1.5, 1.5]
    assert [over_the_middle(0.5, None, share) for share in shares] == [0.5] * 5


def test_the_nearer_limit_counts(clock: None) -> None:
    budget = Budget(1000, minutes=0.5)
    budget.start()
    for _ in range(6):
        budget.tick()
    assert budget.elapsed == 6
    assert (budget.share(100), budget.share(400)) == (0.2, 0.4)
    assert (budget.expected_steps(100), budget.expected_steps(400)) == (500, 1000)
    assert budget.reached(100, 0.2)
    assert not budget.reached(100, 0.21)
    for _ in range(25):
        budget.tick()
    assert budget.reached(100)
    assert budget.expected_steps(100) == 100
    assert budget.summary(100) == "0.5 of 0.5 minutes used, 100 of at most 1,000 steps"


def test_without_minutes_no_clock_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    budget = Budget(1000)
    monkeypatch.setattr(budget_module.time, "monotonic", lambda: pytest.fail("a clock was read"))
    budget.tick()
    assert budget.state() == {"elapsed": 0.0, "total": 1000, "again": 0}
    assert (budget.share(250), budget.expected_steps(250)) == (0.25, 1000)
    assert [budget.reached(step) for step in (999, 1000)] == [False, True]


def test_steps_that_are_made_again_do_not_count() -> None:
    budget = Budget(1000)
    budget.go_back(700, 0.3)
    assert budget.again == 400
    assert (budget.share(700), budget.share(900), budget.expected_steps(900)) == (0.3, 0.5, 1400)
    assert [budget.reached(step) for step in (1399, 1400)] == [False, True]
    assert [budget.reached(step, 0.5) for step in (899, 900)] == [False, True]
    other = Budget(1000)
    other.restore(budget.state())
    assert other.state() == budget.state()
    budget.begin_second_half(800)
    assert [budget.reached(step) for step in (1199, 1200)] == [False, True]


def test_minutes_decide_as_steps_do(
    clock: None, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where each pass takes a second, 150 seconds give the bits of 150 passes, also where they are interrupted."""
    recorder = Recorder(monkeypatch)
    train(
        "student",
        training("student", compose_config, "student.total_steps=1200", "student.second_try=false"),
        tmp_path / "steps",
    )
    by_steps = files(tmp_path / "steps")
    recorder.again()
    config = training("student", compose_config, *BY_MINUTES)
    train("student", config, tmp_path / "minutes")
    assert recorder.steps[-1] == 1200
    whole = (recorder.state, files(tmp_path / "minutes"))
    assert whole[1] == by_steps
    table = pd.read_csv(tmp_path / "minutes" / gait_check.FILE)
    assert table.step.tolist() == [400, 800, 1200]
    interrupt("student", config, tmp_path / "cut", recorder, 800)
    assert (tmp_path / "cut" / CHECKPOINT).is_dir()
    train("student", config, tmp_path / "cut")
    assert recorder.steps[0] == 808
    assert (recorder.state, files(tmp_path / "cut")) == whole


@pytest.mark.parametrize(("minutes", "total", "says"), [(60, 480, "1.0 of 60"), (0.5, 480, "0.5 of 0.5")])
def test_the_log_says_what_was_used(
    minutes: float, total: int, says: str, clock: None, compose_config: Composer, tmp_path: Path
) -> None:
    """Both in a baseline; the first limit ends it."""
    keys = (f"student.minutes={minutes}", f"student.total_steps={total}", "discriminator=none", "eta=1")
    config = training("student", compose_config, *keys, "student.check_steps=0")
    log = SilentLog()
    student.run(config, {}, tmp_path, log)
    steps = min(total, round(8 * 60 * minutes))
    assert log.messages == [f"{says} minutes used, {steps} of at most {total} steps"]
    assert log.rows[-1][0] == steps


def test_minutes_are_a_positive_number() -> None:
    allowed = "a number > 0 and <= 1000000 min, or null"
    for value in ("0", "-1", "nan", "ten"):
        assert faults([f"student.minutes={value}"]) == [f"student.minutes: {value} is not allowed; allowed: {allowed}"]
    assert faults(["student.minutes=null"]) == faults(["student.minutes=0.5"]) == []
