"""When a training's gait is checked, which policy is kept, and how a resumed training goes on."""

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

from romgrl.algorithms.sac import load_sac_policy
from romgrl.config.schema import Config
from romgrl.gait.features import Gait
from romgrl.gait.recording import record
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.training import gait_check
from romgrl.stages.training.budget import Budget
from romgrl.stages.training.gait_check import GaitChecks, percent, rank, shortcomings
from romgrl.stages.wiring.humanoid import humanoid_env
from tests.conftest import Composer
from tests.helpers.cut_trainings import write_reference
from tests.helpers.synthetic_gait import DT, run

GOOD = {
    "falls": 0.0,
    "speed_error_percent": -2.9,
    "cadence_error_percent": 4.9,
    "trunk_lean_deg": 9.9,
    "error_over_variance": 0.3,
    "task_reward": 0.9,
    "steady_speed_m_per_s": 4.0,
    "passed": 1.0,
}
Row = dict[str, float]


class Learner:
    """Stands for an agent whose weights and moments are its number of steps."""

    def __init__(self, step: float) -> None:
        self.sac = self.normalizer = self.average = self
        self.network = {"inputs": 3, "hidden_sizes": [2], "outputs": 2}
        self.flat = torch.full((14,), step)
        self.eta = 0.35

    def mean_and_scale(self) -> tuple[torch.Tensor, torch.Tensor]:
        return torch.full((3,), -self.flat[0]), torch.full((3,), 2 * self.flat[0])


def checks(
    config: Config, output: Path, rows: list[Row], monkeypatch: pytest.MonkeyPatch, *, interval: int = 100
) -> GaitChecks:
    """Checks that find one of `rows` after the other."""
    found = iter(rows)
    monkeypatch.setattr(gait_check, "record", lambda *_, **__: None)
    env: Any = SimpleNamespace(close=lambda: None, control_step=DT) if interval else None
    made = GaitChecks(interval, config, env, None, torch.arange(3), None, output, SilentLog())
    monkeypatch.setattr(made, "measure", lambda _: next(found))
    return made


def go(made: GaitChecks, start: int, stop: int, each: int, total: int | None = None) -> None:
    for step in range(start, stop + 1, each):
        made.check_if_due(step, Learner(step), Budget(total or 10**9))


@pytest.mark.parametrize(
    ("interval", "each", "steps"),
    [
        (100, 30, [120, 210, 300, 420, 510, 600]),
        (100, 100, [100, 200, 300, 400, 500, 600]),
        (250, 60, [300, 540, 600]),
        (1000, 60, [600]),
        (20, 150, [150, 300, 450, 600]),  # no more than one for each pass
        (0, 60, []),
    ],
)
def test_due_at_each_multiple_and_at_the_end(
    interval: int,
    each: int,
    steps: list[int],
    smoke_config: Config,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = checks(smoke_config, tmp_path, [GOOD] * 20, monkeypatch, interval=interval)
    go(made, each, 600, each, total=600)
    assert [row["step"] for row in made.rows] == steps
    assert (tmp_path / gait_check.FILE).is_file() == bool(steps)
    if steps:
        assert pd.read_csv(tmp_path / gait_check.FILE).step.tolist() == steps


def test_the_best_is_kept(smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of those that are equally good; its weights and the moments that it had then."""
    rows = [GOOD | {"error_over_variance": error} for error in (0.5, 0.2, 0.2, 0.3)]
    made = checks(smoke_config, tmp_path, rows, monkeypatch)
    made.teacher = object()
    go(made, 100, 400, 100)
    learner = Learner(400)
    mean, scale = made.keep_best(learner)
    assert learner.flat.tolist() == [200.0] * 14
    assert (mean.tolist(), scale.tolist()) == ([-200.0] * 3, [400.0] * 3)
    log = made.log
    assert isinstance(log, SilentLog)
    said = "falls in 0 of 16 episodes, 4.00 m/s, error over variance 0.20"
    assert log.messages[-1] == f"kept the policy of step 200: {said}"


@pytest.mark.parametrize(("kept", "step"), [("reference", 200), ("task_reward", 300), ("last", 400)])
def test_which_policy_is_kept(
    kept: str, step: int, smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None that falls more, but for the last one."""
    smoke_config.student.kept_policy = kept
    fell = GOOD | {"falls": 1.0, "task_reward": 1.0, "passed": 0.0, "error_over_variance": 0.01}
    near, fast = GOOD | {"error_over_variance": 0.1}, GOOD | {"task_reward": 0.95}
    made, learner = checks(smoke_config, tmp_path, [fell, near, fast, fell], monkeypatch), Learner(400)
    go(made, 100, 400, 100)
    made.teacher = object()
    made.keep_best(learner)
    assert learner.flat[0] == step


def test_without_checks_the_last_is_kept(smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, learner = checks(smoke_config, tmp_path, [], monkeypatch, interval=0), Learner(400)
    mean, _ = made.keep_best(learner)
    assert (learner.flat[0], mean[0]) == (400, -400)
    assert not list(tmp_path.iterdir())


def test_what_is_better() -> None:
    nan = float("nan")
    order: list[Row] = [
        GOOD,
        GOOD | {"error_over_variance": 0.4},
        GOOD | {"error_over_variance": nan},
        GOOD | {"passed": 0.0, "error_over_variance": 0.1},
        GOOD | {"passed": 0.0, "error_over_variance": nan, "task_reward": 1.0},
        GOOD | {"passed": 0.0, "error_over_variance": nan, "task_reward": 0.5},
        GOOD | {"falls": 1.0, "passed": 0.0, "error_over_variance": 0.1},
    ]
    assert all(rank(better) < rank(worse) for better, worse in pairwise(order))
    baseline: list[Row] = [{"falls": 0, "task_reward": 0.5}, {"falls": 0, "task_reward": 0.4}]
    baseline.append({"falls": 1, "task_reward": 0.9})
    assert all(rank(better) < rank(worse) for better, worse in pairwise(baseline))


@pytest.mark.parametrize(
    "change",
    [
        {"falls": 1},
        {"speed_error_percent": 3.1},
        {"speed_error_percent": -3.1},
        {"cadence_error_percent": -5.1},
        {"trunk_lean_deg": -10.1},
        {"cadence_error_percent": float("nan")},
    ],
)
def test_what_passes(change: Row) -> None:
    assert shortcomings(GOOD) == []
    assert len(shortcomings(GOOD | change)) == 1


def test_passes_in_a_row(smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = checks(smoke_config, tmp_path, [GOOD | {"passed": value} for value in (1, 0, 1, 1)], monkeypatch)
    counts = []
    for step in (100, 200, 300, 400):
        go(made, step, step, 100)
        counts.append(made.passes())
    assert counts == [1, 0, 1, 2]


@pytest.mark.parametrize("cut", [0, 250, 300])
def test_a_resumed_training_has_the_same_rows(
    cut: int, smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it was cut before the first check; the file has the same bytes."""
    rows = [GOOD | {"falls": 4, "error_over_variance": error} for error in (0.5, 0.2, float("nan"), 0.1, 0.3)]
    whole = checks(smoke_config, tmp_path, rows, monkeypatch)
    go(whole, 50, 500, 50)
    written = (tmp_path / gait_check.FILE).read_bytes()
    first = checks(smoke_config, tmp_path, rows, monkeypatch)
    go(first, 50, cut, 50)
    state = first.state()
    second = checks(smoke_config, tmp_path, rows[cut // 100 :], monkeypatch)
    second.restore(state)
    go(second, cut + 50, 500, 50)
    assert (tmp_path / gait_check.FILE).read_bytes() == written
    assert repr(second.rows) == repr(whole.rows)
    assert all(torch.equal(one, other) for one, other in zip(second.best, whole.best, strict=True))
    assert second.best[0][0] == 400


def gait(frequency: float, speed: float = 4.0, episodes: int = 4) -> Gait:
    features, _ = run(episodes=episodes, frequency=frequency)
    ones = np.ones(features.shape[:2])
    return Gait(features, ones > 0, np.zeros(episodes, bool), DT, velocity=speed * ones, trunk_lean=0.1 * ones)


def test_a_row_by_hand(smoke_config: Config, tmp_path: Path) -> None:
    """A student that is slower, and strides more often, than its teacher."""
    made = GaitChecks(0, smoke_config, None, gait(1.5), torch.arange(3), None, tmp_path, SilentLog())
    row = made.measure(gait(1.59, speed=3.8))
    assert row["speed_error_percent"] == pytest.approx(-5.0)
    assert row["cadence_error_percent"] == pytest.approx(6.0, abs=0.5)
    assert row["excursion_percent"] == pytest.approx(100.0, abs=3.0)
    assert row["task_reward"] == pytest.approx(np.exp(-0.2))
    assert row["trunk_lean_deg"] == pytest.approx(np.degrees(0.1))
    assert row["error_over_variance"] > 0.05
    assert (row["falls"], row["passed"]) == (0, 0.0)
    itself = made.measure(gait(1.5))
    assert itself["error_over_variance"] < 0.03
    assert itself["passed"] == 1.0
    assert (percent(3.0, 4.0), str(percent(1.0, 0.0))) == (75.0, "nan")
    made.teacher = None
    assert made.measure(gait(1.5)).keys() == row.keys() - {
        *("cadence_error_percent", "excursion_percent", "error_over_variance", "passed")
    }


def test_nothing_after_a_fall_counts_and_the_resets_are_the_same(compose_config: Composer) -> None:
    """With targets that do not move, most fall."""
    env = humanoid_env(compose_config("experiment=smoke"), num_envs=4, episode_steps=61)
    policy: Any = lambda observation: np.zeros((len(observation), 21), np.float32)  # noqa: E731
    one, other = (record(env, policy, steps=60, seed=3, dt=env.control_step) for _ in range(2))
    assert one.fallen.tolist() == [not valid.all() for valid in one.valid]
    assert (np.diff(one.valid.astype(int), axis=1) <= 0).all()
    assert 5 < one.valid[one.fallen].sum(axis=1).min() < 60
    assert np.array_equal(one.features, other.features)


@pytest.mark.parametrize("stage", ["student", "baseline"])
def test_the_policy_file_is_the_best_and_a_check_leaves_the_training_as_it_is(
    stage: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is drawn for a check is not drawn from the training: with and without, the learner ends the same."""
    monkeypatch.setattr(gait_check, "EPISODES", 2)
    monkeypatch.setattr(gait_check, "STEPS", 20)
    rows = iter([0.3, 0.1, 0.2])
    monkeypatch.setattr(gait_check, "rank", lambda row, kept: (row["order"],))
    measure = GaitChecks.measure
    monkeypatch.setattr(GaitChecks, "measure", lambda *a: measure(*a) | {"order": next(rows)})
    kept: list[Any] = []
    build = student.build_student_learner
    monkeypatch.setattr(student, "build_student_learner", lambda *a: kept.append(build(*a)) or kept[-1])
    inputs = {"reference": write_reference(tmp_path / "reference")} if stage == "student" else {}
    keys = ["experiment=smoke", "student.total_steps=600", "student.learning_starts=400", "student.adapt_eta=false"]
    keys += ["student.second_try=false"]
    keys += [] if inputs else ["discriminator=none", "eta=1"]
    for name, interval in (("with", 250), ("without", 0)):
        (tmp_path / name).mkdir()
        config = compose_config(*keys, f"student.check_steps={interval}")
        student.run(config, inputs, tmp_path / name, SilentLog())
    table = pd.read_csv(tmp_path / "with" / gait_check.FILE)
    assert table.step.tolist() == [256, 504, 600]
    assert ("error_over_variance" in table) == bool(inputs)
    assert torch.equal(kept[0].sac.policy.flat, kept[1].sac.policy.flat)
    policy, last = (load_sac_policy(tmp_path / name / "policy.safetensors") for name in ("with", "without"))
    assert not torch.equal(policy.policy.flat, last.policy.flat)
    assert not torch.equal(policy.mean, last.mean)
    assert torch.equal(last.policy.flat, kept[1].sac.average.flat)


def test_two_passed_checks_in_a_row_begin_the_second_half(
    smoke_config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many steps are left as were made; later, and without `end_early`, the budget stays."""
    for early, passes, total in (
        (True, (0, 1, 1, 1), 600),
        (False, (0, 1, 1, 1), 1000),
        (True, (0, 0, 0, 0, 1, 1), 1000),
    ):
        smoke_config.student.end_early = early
        made = checks(smoke_config, tmp_path, [GOOD | {"passed": float(value)} for value in passes], monkeypatch)
        budget = Budget(1000)
        for step in range(100, 100 * len(passes) + 1, 100):
            made.check_if_due(step, Learner(step), budget)
        assert budget.total == total
