"""Diagnoses of the discriminator: synthetic curves with one fault each, measures by hand, trainings forced into two."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from romgrl.algorithms.discriminator_health import LASTING_ROWS, WATCHED, TrainingSetting, diagnose, trend
from romgrl.pipeline.job import health_tags
from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import student
from romgrl.stages.training.discriminator_watch import HealthWatch, health_setting
from tests.algorithms.test_adversarial_losses import gaussian_discriminator
from tests.conftest import Composer
from tests.helpers.cut_trainings import STUDENT, write_reference

SETTING = TrainingSetting(
    speed=4.0, eta=0.5, reward_limit=3.0, undecided_reward=math.log(2), undecided_loss=2 * math.log(2)
)
HEALTHY = {
    "discriminator_accuracy_teacher": 0.97,
    "discriminator_accuracy_student": 0.88,
    "discriminator_logit_teacher": 1.5,
    "discriminator_logit_student": -0.8,
    "discriminator_logit_spread": 1.4,
    "discriminator_fit_loss": 1.0,
    "discriminator_held_out_loss": 1.02,
    "discriminator_feature_gap": 0.6,
    "imitation_reward": 0.5,
    "imitation_share": 0.55,
    "speed": 3.6,
}
PERFECT = {"discriminator_accuracy_teacher": 1.0, "discriminator_accuracy_student": 0.99}
Curve = list[dict[str, float]]


def curve(count: int = LASTING_ROWS, **changes: float | tuple[float, float]) -> Curve:
    """Rows of a healthy training; a changed column is constant, or goes from one value to another."""
    ends = {name: value if isinstance(value, tuple) else (value, value) for name, value in changes.items()}
    lines = {name: np.linspace(*pair, count) for name, pair in ends.items()}
    rising = {"imitation_reward": np.linspace(0.4, 0.5, count), "imitation_share": np.linspace(0.6, 0.5, count)}
    columns = rising | lines
    return [HEALTHY | {name: float(line[i]) for name, line in columns.items()} for i in range(count)]


SICK: dict[str, Curve] = {
    "saturated": curve(**PERFECT, imitation_reward=0.11),
    "collapsed": curve(
        discriminator_logit_teacher=0.03,
        discriminator_logit_student=0.01,
        discriminator_logit_spread=0.02,
        discriminator_feature_gap=1.4,
    ),
    "overfitted": curve(discriminator_fit_loss=(0.9, 0.6), discriminator_held_out_loss=(1.1, 1.5)),
    "ignored": curve(imitation_share=(0.04, 0.03)),
    "standing_still": curve(speed=(0.1, 0.3), imitation_reward=(0.6, 0.8)),
}


@pytest.mark.parametrize("name", SICK)
def test_each_fault_is_found_alone(name: str) -> None:
    (found,) = diagnose(SICK[name], SETTING)
    assert found.name == name
    assert any(character.isdigit() for character in found.evidence)
    assert "discriminator." in found.advice or "eta" in found.advice


def test_saturated_at_the_limit_of_the_reward() -> None:
    (found,) = diagnose(curve(**PERFECT, imitation_reward=(2.97, 3.0)), SETTING)
    assert found.name == "saturated"
    assert diagnose(curve(**PERFECT, imitation_reward=(2.97, 3.0)), TrainingSetting(4.0, 0.5, None, 0.69, 1.39)) == []


def test_a_low_reward_that_goes_nowhere_is_ignored() -> None:
    rows = curve(imitation_share=0.5, discriminator_feature_gap=1.0)
    for row, reward in zip(rows, (0.300, 0.304, 0.298, 0.303, 0.301), strict=True):
        row["imitation_reward"] = reward
    (found,) = diagnose(rows, SETTING)
    assert found.name == "ignored"
    for row, reward in zip(rows, (0.300, 0.301, 0.302, 0.303, 0.304), strict=True):
        row["imitation_reward"] = reward
    assert diagnose(rows, SETTING) == []  # it climbs


@pytest.mark.parametrize(
    "changes",
    [
        {},
        PERFECT,  # sure of itself, but the reward has a slope
        {"imitation_reward": 0.11},  # low, but it errs
        {"discriminator_logit_spread": 0.02, "discriminator_feature_gap": 1.4},  # constant within, apart between
        {"discriminator_fit_loss": (0.6, 0.9), "discriminator_held_out_loss": (1.1, 1.5)},  # both rise
        {"discriminator_held_out_loss": (1.05, 1.1), "discriminator_fit_loss": (1.03, 1.0)},  # hardly apart
        {"speed": (0.1, 2.0), "imitation_reward": 0.8},  # has begun to walk
        {"speed": 0.2, "imitation_reward": (0.5, 0.3)},  # stands, but is not paid for it
    ],
)
def test_healthy_curves(changes: dict[str, float | tuple[float, float]]) -> None:
    assert diagnose(curve(**changes), SETTING) == []


def test_a_matched_student_is_no_collapse() -> None:
    """At the aim the best discriminator is undecided, too: the features tell."""
    rows = [row | {"discriminator_feature_gap": 0.1} for row in SICK["collapsed"]]
    assert diagnose(rows, SETTING) == []


def test_too_few_rows_and_missing_columns_say_nothing() -> None:
    assert diagnose(SICK["saturated"][1:], SETTING) == []
    for name in WATCHED:
        rows = [dict(row) for row in SICK["saturated"]]
        del rows[2][name]
        assert diagnose(rows, SETTING) == []


def test_trend_is_spearmans() -> None:
    from scipy.stats import spearmanr

    values = np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0])
    assert trend(values) == pytest.approx(spearmanr(values, np.arange(7)).statistic)
    assert trend(np.ones(5)) == 0.0


def test_measures_by_hand() -> None:
    """Logit 2 x on a teacher N(0.5, 1) and a student N(-0.5, 2)."""
    discriminator = gaussian_discriminator()
    discriminator.logits = lambda frames: 2 * frames[:, 0]
    values = discriminator.measures(2 * torch.randn((40_000, 1), generator=torch.Generator().manual_seed(3)) - 0.5)
    assert values["discriminator_logit_teacher"] == pytest.approx(1.0, abs=0.05)
    assert values["discriminator_logit_student"] == pytest.approx(-1.0, abs=0.07)
    assert values["discriminator_logit_spread"] == pytest.approx(math.sqrt((4 + 16) / 2 + 1), rel=0.05)
    assert values["discriminator_feature_gap"] == pytest.approx(math.sqrt((1 + math.log(2) ** 2) / 2), rel=0.03)
    assert values["discriminator_fit_loss"] == pytest.approx(values["discriminator_held_out_loss"], rel=0.03)


def test_what_an_undecided_judge_pays(compose_config: Composer) -> None:
    expected = {"bce": (math.log(2), 2 * math.log(2)), "least_squares": (0.75, 2.0), "wasserstein": (1.0, 1.0)}
    for loss, pair in expected.items():
        found = health_setting(compose_config(f"discriminator.loss={loss}"))
        assert (found.undecided_reward, found.undecided_loss) == pytest.approx(pair)


def test_a_line_when_it_begins_and_a_history(compose_config: Composer, tmp_path: Path) -> None:
    """Not at every row; what is restored goes on as if nothing had happened."""
    rows = [*curve(3), *SICK["saturated"], *SICK["saturated"], *curve(2)]
    log, config = SilentLog(), compose_config()
    watch = HealthWatch(config, tmp_path, log)
    for number, row in enumerate(rows):
        if number == 8:
            state, watch = watch.state(), HealthWatch(config, tmp_path, log)
            watch.restore(state)
        watch.add(row, 1000 * (number + 1), 0.3)
        if number < LASTING_ROWS - 1:
            assert health_tags(tmp_path) == {"romgrl.discriminator_health": "too short to tell"}
    (message,) = log.messages
    assert message.startswith("discriminator: saturated at step 8,000: accuracy 1.00 and 0.99")
    document = json.loads((tmp_path / "health.json").read_text(encoding="utf-8"))
    assert document["verdict"] == "healthy"
    assert document["history"] == [{"name": "saturated", "first_step": 8000, "last_step": 13000}]
    assert health_tags(tmp_path) == {"romgrl.discriminator_health": "healthy"}
    assert health_tags(tmp_path / "nothing") == {}


FORCED = {
    "saturated": (
        "discriminator.gradient_penalty=0",
        "discriminator.learning_rate=1e-2",
        "discriminator.dropout=0",
        "discriminator.label_smoothing=0",
    ),
    "collapsed": ("discriminator.learning_rate=1e-12",),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FORCED)
def test_a_training_is_forced_into_it(
    name: str, compose_config: Composer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(student, "LOG_INTERVAL", 160)
    log = SilentLog()
    often = (
        "student.total_steps=1600",
        "discriminator.update_interval=1",
        "noise=0",
        "student.reference_resets=0",
        *FORCED[name],
    )
    config = compose_config(*STUDENT, *often)
    student.run(config, {"reference": write_reference(tmp_path / "reference")}, tmp_path, log)
    assert len([message for message in log.messages if message.startswith(f"discriminator: {name} at step")]) == 1
    document = json.loads((tmp_path / "health.json").read_text(encoding="utf-8"))
    assert name in document["verdict"].split(", ")
    assert {"collapsed": "saturated", "saturated": "collapsed"}[name] not in document["verdict"]
    assert document["now"][0]["advice"]
