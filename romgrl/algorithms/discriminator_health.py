"""What is wrong between discriminator and policy, from the last rows of the learning curve: names, numbers, advice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Series = Mapping[str, NDArray[np.float64]]

WATCHED = (
    "discriminator_accuracy_teacher",
    "discriminator_accuracy_student",
    "discriminator_logit_teacher",
    "discriminator_logit_student",
    "discriminator_logit_spread",
    "discriminator_fit_loss",
    "discriminator_held_out_loss",
    "discriminator_feature_gap",
    "imitation_reward",
    "imitation_share",
    "speed",
)
"""What a diagnosis reads of a row."""

LASTING_ROWS = (
    5  # a diagnosis holds over this many rows, about 20,000 steps: the start of a training has bad rows in between
)
# Rewards are shares of what an undecided discriminator pays: bce log 2, least_squares 3/4, wasserstein 1.
CERTAIN = 0.97  # accuracy on both streams; noise and dropout keep discriminators that are still useful near 0.9
WORTHLESS = 0.18  # labels 0.1 and 0.9, told perfectly, leave softplus(-log 9) = 0.105, 0.15 of log 2
LIMIT = 0.98  # of reward_limit: the clamp has taken the slope away
FLAT = 0.25  # logits; untrained networks of these sizes spread by 0.1, discriminators that learned by more than 1
APART = 0.5  # standard deviations of the teacher, root mean square over columns; students that run well have less
OVERFIT = 0.15  # of the loss of an undecided discriminator
SILENT_SHARE = 0.05  # below it the imitation reward is noise beside the task reward
SAME_SHARE, SAME_REWARD = 0.02, 0.05  # span over the rows
UNRELATED = 0.3  # rank correlation with time
STANDING = 0.25  # of the target speed
PAID = 0.8  # a plausible pose earns about what an undecided discriminator pays


class Diagnosis(NamedTuple):
    """What is wrong, the numbers that say so, and what to change."""

    name: str
    evidence: str
    advice: str


@dataclass(frozen=True)
class TrainingSetting:
    """What the numbers are measured against: target speed in m/s, the reward and loss of an undecided discriminator."""

    speed: float
    eta: float
    reward_limit: float | None
    undecided_reward: float
    undecided_loss: float


def diagnose(rows: Sequence[Mapping[str, float]], setting: TrainingSetting) -> list[Diagnosis]:
    """All that holds over the last ROWS rows; nothing where there are fewer, or where a row lacks one of COLUMNS."""
    last = rows[-LASTING_ROWS:]
    if len(last) < LASTING_ROWS or any(name not in row for row in last for name in WATCHED):
        return []
    series = {name: np.array([row[name] for row in last]) for name in WATCHED}
    found = [check(series, setting) for check in DIAGNOSES]
    return [diagnosis for diagnosis in found if diagnosis is not None]


def saturated(series: Series, setting: TrainingSetting) -> Diagnosis | None:
    """It tells every window, and its reward lies at zero or at its limit: no slope is left to climb."""
    teacher, student = (float(series[f"discriminator_accuracy_{name}"].mean()) for name in ("teacher", "student"))
    reward = series["imitation_reward"]
    worthless = reward.max() <= WORTHLESS * setting.undecided_reward
    limited = setting.reward_limit is not None and reward.min() >= LIMIT * setting.reward_limit
    if min(teacher, student) < CERTAIN or not (worthless or limited):
        return None
    gap = float((series["discriminator_logit_teacher"] - series["discriminator_logit_student"]).mean())
    return Diagnosis(
        "saturated",
        f"accuracy {teacher:.2f} and {student:.2f}, logits {gap:.1f} apart, imitation reward {reward.mean():.3f}",
        "lower discriminator.learning_rate, raise discriminator.gradient_penalty, discriminator.update_interval or "
        "noise",
    )


def collapsed(series: Series, setting: TrainingSetting) -> Diagnosis | None:
    """It says the same of everything, although means and spreads of the features differ."""
    spread, apart = series["discriminator_logit_spread"], series["discriminator_feature_gap"]
    gap = np.abs(series["discriminator_logit_teacher"] - series["discriminator_logit_student"])
    if spread.max() > FLAT or gap.max() > FLAT or apart.min() < APART:
        return None
    return Diagnosis(
        "collapsed",
        f"logits spread by {spread.mean():.3f} and {gap.mean():.3f} apart, features {apart.mean():.2f} deviations",
        "raise discriminator.learning_rate, lower discriminator.gradient_penalty or noise, and see that "
        "discriminator.standardize is on",
    )


def overfitted(series: Series, setting: TrainingSetting) -> Diagnosis | None:
    """It knows the teacher's windows by heart: better on them, worse on the held-out ones."""
    fit, held_out = series["discriminator_fit_loss"], series["discriminator_held_out_loss"]
    excess = float((held_out - fit).mean())
    falls, rises = trend(fit) < 0, trend(held_out) > 0
    if excess < OVERFIT * setting.undecided_loss or not (falls and rises):
        return None
    return Diagnosis(
        "overfitted",
        f"loss {fit[0]:.2f} to {fit[-1]:.2f} on the windows it learns from, {held_out[0]:.2f} to {held_out[-1]:.2f} "
        "on held-out ones",
        "raise reference.steps and reference.episodes, discriminator.dropout or noise; smaller "
        "discriminator.hidden_sizes; set discriminator.patience",
    )


def ignored(series: Series, setting: TrainingSetting) -> Diagnosis | None:
    """The policy does not answer to it: too small a share, or a low reward that goes nowhere while gaits differ."""
    share, reward = series["imitation_share"], series["imitation_reward"]
    if share.max() <= SILENT_SHARE and saturated(series, setting) is None:
        evidence = f"imitation is {100 * share.mean():.1f}% of the reward with eta={setting.eta:g}"
        return Diagnosis("ignored", evidence, "lower eta")
    still = np.ptp(share) <= SAME_SHARE and np.ptp(reward) <= SAME_REWARD * setting.undecided_reward
    low = reward.max() <= 0.5 * setting.undecided_reward and series["discriminator_feature_gap"].min() >= APART
    follows = trend(reward)
    if not (still and low) or abs(follows) > UNRELATED or saturated(series, setting) is not None:
        return None
    evidence = (
        f"share {share.min():.2f} to {share.max():.2f}, imitation reward {reward.mean():.3f} with rank correlation "
        f"{follows:+.2f} with time, eta={setting.eta:g}"
    )
    return Diagnosis("ignored", evidence, "lower eta, or raise discriminator.window so that the reward tells more")


def standing_still(series: Series, setting: TrainingSetting) -> Diagnosis | None:
    """A plausible pose is paid well, so nobody walks."""
    speed, reward = series["speed"], series["imitation_reward"]
    if speed.max() > STANDING * setting.speed or reward.min() < PAID * setting.undecided_reward:
        return None
    return Diagnosis(
        "standing_still",
        f"{speed.mean():.2f} m/s of {setting.speed:g} m/s with imitation reward {reward.mean():.2f}",
        "raise discriminator.window or use discriminator.features=trunk_velocities, which tell standing from walking; "
        "lower discriminator.recent_steps; raise eta or humanoid.reset_speed",
    )


def trend(values: NDArray[np.float64]) -> float:
    """Spearman's rank correlation with time; 0 where all are equal."""
    ranks = np.array([(values < value).sum() + 0.5 * (values == value).sum() for value in values])
    time = np.arange(len(values), dtype=float)
    spread = float(ranks.std() * time.std())
    return float(((ranks - ranks.mean()) * (time - time.mean())).mean()) / spread if spread > 0 else 0.0


DIAGNOSES: tuple[Callable[[Series, TrainingSetting], Diagnosis | None], ...] = (
    saturated,
    collapsed,
    overfitted,
    ignored,
    standing_still,
)
