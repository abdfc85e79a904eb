"""A gait in numbers. Free functions on arrays: features (E, T, 5) m, contact (E, T, 2), velocity (E, T) m/s, dt s.

`valid` (E, T) marks the steps that count, one run from each episode's start (None: all); what follows a fall does not.
Every function averages over episodes and returns nan where no episode is long enough to tell.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import BODY_Y, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Bools, Floats, Gait
from romgrl.gait.load_metrics import describe_loads
from romgrl.gait.periodicity import concordance, frequency, lag

Scalar = TypeVar("Scalar", bound=np.generic)

GRAVITY = 9.81
ENERGY_MEASURES = (
    "cost_of_transport",
    "cost_without_retraction",
    "positive_power_w_per_kg",
    "positive_power_without_retraction_w_per_kg",
)
"""Columns of gait.csv."""
STRIDING = {False: [LEFT_X, RIGHT_X], True: [BODY_Y]}
"""The channels whose swings are strides, or hops."""
SETTLING_TIME = 4.0  # s from reset until a gait is called steady


def falls(upright: Bools) -> int:
    """Episodes with at least one step that is not upright. upright: (E, T)."""
    return int((~upright.all(axis=1)).sum())


def mean_speed(velocity: Floats, valid: Bools | None = None) -> float:
    """Mean forward speed over all valid steps, m/s."""
    return _masked_mean(velocity, valid)


def stride_frequency(features: Floats, dt: float, valid: Bools | None = None, *, hops: bool = False) -> float:
    """Strides per second: forward swings of each foot relative to the body, mean over feet, median over episodes.

    A stride is two steps, from one event of a foot to the same event of that foot (Winter, Biomechanics and Motor
    Control of Human Movement, ch. 3); the swings are counted by `periodicity.frequency`. hops: the body's bounces count
    instead, since the feet of a hop on the spot do not swing.
    """
    return _nanmedian([frequency(e[:, STRIDING[hops]], dt) for e in _episodes(features, valid)])


def left_right_correlation(features: Floats, valid: Bools | None = None) -> float:
    """Pearson correlation of left and right foot x: -1 strict alternation, +1 a two-legged hop."""
    values = []
    for episode in _episodes(features, valid):
        left, right = episode[:, LEFT_X], episode[:, RIGHT_X]
        if len(episode) > 2 and left.std() > 1e-9 and right.std() > 1e-9:
            values.append(float(np.corrcoef(left, right)[0, 1]))
    return _nanmean(values)


def left_right_symmetry(features: Floats, dt: float, valid: Bools | None = None) -> float:
    """How well the right foot repeats the left foot's motion some time later: 1 exactly, 0 not at all.

    Largest, over time shifts within one stride, concordance correlation (Lin 1989, Biometrics 45:255) of left and right
    foot x: 2 cov / (var_L + var_R + (mean_L - mean_R)^2); differences of shape, amplitude and offset all lower it.
    """
    values = []
    for episode in _episodes(features, valid):
        rate = frequency(episode[:, [LEFT_X, RIGHT_X]], dt)
        if np.isfinite(rate):
            shifts = np.arange(0.0, 1.0 / (rate * dt), 0.25)
            left, right = episode[:, LEFT_X], episode[:, RIGHT_X]
            values.append(max(concordance(left, right, shift) for shift in shifts))
    return _nanmean(values)


def body_height(features: Floats, valid: Bools | None = None) -> float:
    """Mean height of the body above the ground, m."""
    return _masked_mean(features[..., BODY_Y], valid)


def body_excursion(features: Floats, dt: float, valid: Bools | None = None, *, hops: bool = False) -> float:
    """Highest minus lowest body height within a stride, or a bounce where it hops, mean over strides, m."""
    values = []
    for episode in _episodes(features, valid):
        rate = frequency(episode[:, STRIDING[hops]], dt)
        if np.isfinite(rate):
            length = round(1.0 / (rate * dt))
            strides = episode[: len(episode) // length * length, BODY_Y].reshape(-1, length)
            values.append(float(np.ptp(strides, axis=1).mean()))
    return _nanmean(values)


def trunk_lean_degrees(trunk_lean: Floats, valid: Bools | None = None) -> float:
    """Mean inclination of the trunk in degrees, forward positive. trunk_lean: (E, T) rad."""
    return float(np.degrees(_masked_mean(trunk_lean, valid)))


def cost_of_transport(power: Floats, velocity: Floats, mass: float, valid: Bools | None = None) -> float:
    """Mechanical cost of transport: sum |torque x omega| dt / (m g d), d = sum v dt.

    Collins et al. 2005, Science 307:1082. power: (E, T) W, summed over actuators. nan where nothing moves forward.
    """
    speed = _masked_mean(velocity, valid)
    return _masked_mean(power, valid) / (mass * GRAVITY * speed) if speed > 1e-3 else float("nan")


def steady_steps(valid: Bools, dt: float) -> Bools:
    """The valid steps (E, T) without the first SETTLING_TIME of each episode, at most half of T: a walker that starts
    from a reset speeds up there, the reference does not. All valid steps where no episode lasts as long."""
    steady = valid.copy()
    steady[:, : min(round(SETTLING_TIME / dt), valid.shape[1] // 2)] = False
    return steady if steady.any() else valid


def infer_contact(features: Floats, velocity: Floats, dt: float, valid: Bools | None = None) -> Bools:
    """Feet on the ground, guessed from motion alone: the ankle is low and nearly still over the ground.

    Low: within 6 cm of the 2nd percentile of that ankle's height; still: |v + d x_foot / dt| below 0.3 m/s or 40% of
    the mean speed. For walkers that record no contact forces. Shape of the result: (E, T, 2), left and right. A stance
    that was seen in one step alone lasts two, since a foot that is nearly still once does not scuff (`touchdowns`).
    """
    contact = np.zeros((*features.shape[:2], 2), bool)
    limit = max(0.3, 0.4 * abs(np.nan_to_num(_masked_mean(velocity, valid))))
    for index, episode in enumerate(_episodes(features, valid)):
        if len(episode) < 3:
            continue
        for foot, (x, z) in enumerate(((LEFT_X, LEFT_Z), (RIGHT_X, RIGHT_Z))):
            height = episode[:, BODY_Y] + episode[:, z]
            sliding = velocity[index, : len(episode)] + np.gradient(episode[:, x], dt)
            still = (height < np.percentile(height, 2) + 0.06) & (np.abs(sliding) < limit)
            alone = still[1:-1] & ~still[:-2] & ~still[2:]
            still[2:] |= alone
            contact[index, : len(episode), foot] = still
    return contact


def touchdowns(contact: Bools) -> list[int]:
    """Steps at which one foot lands. contact: (T,).

    Gaps of one step are closed first: at 30 Hz they are chatter. What is on the ground for one step alone is no stance
    then, but a toe that scuffs in its swing.
    """
    closed = _without_gaps(contact)
    stays = np.append(closed[1:], True)
    return (np.flatnonzero(closed[1:] & ~closed[:-1] & stays[1:]) + 1).tolist()


def duty_factor(contact: Bools, valid: Bools | None = None) -> float:
    """Share of a stride that a foot is on the ground, mean over feet: below 0.5 the gait is a run.

    Alexander 1989, Physiol. Rev. 69:1199. Counted over whole strides, first to last touchdown of each foot; over all
    steps where a foot lands less than twice.
    """
    values = []
    for episode in _episodes(contact, valid):
        for foot in range(2):
            landings = touchdowns(episode[:, foot])
            span = slice(landings[0], landings[-1]) if len(landings) > 1 else slice(None)
            if len(episode):
                values.append(float(episode[span, foot].mean()))
    return _nanmean(values)


def touchdown_phase(contact: Bools, valid: Bools | None = None) -> float:
    """Phase in [0, 1) of the right touchdown within the left foot's stride, circular mean: 0.5 alternates, 0 hops."""
    phases: list[float] = []
    for episode in _episodes(contact, valid):
        left, right = touchdowns(episode[:, 0]), touchdowns(episode[:, 1])
        for start, stop in pairwise(left):
            phases += [(landing - start) / (stop - start) for landing in right if start <= landing < stop]
    if not phases:
        return float("nan")
    return float(np.angle(np.exp(2j * np.pi * np.asarray(phases)).mean()) / (2 * np.pi) % 1.0)


def mid_stance_rise(height: Floats, contact: Bools, valid: Bools | None = None) -> float:
    """How much higher the body is in the middle of a stance than at its two ends, m, mean over stances: above 0 it
    vaults, as in a walk, below 0 it bounces. height (E, T); contact (E, T, 2). nan without a whole stance."""
    rises = []
    for body, feet in zip(_episodes(height, valid), _episodes(contact, valid), strict=True):
        for foot in feet.T:
            stances = _without_gaps(foot)
            for start, stop in pairwise(touchdowns(foot)):
                lifted = start + int(stances[start:stop].argmin())
                if lifted > start:
                    rises.append(float(body[(start + lifted) // 2] - 0.5 * (body[start] + body[lifted])))
    return _nanmean(rises)


def phase_lag(windows: Floats, reference_windows: Floats, dt: float, rate: float) -> tuple[float, float]:
    """Time that each foot's x is still off the reference after the common alignment: (seconds, strides), mean of |lag|.

    windows, reference_windows: (E, W, 5), already aligned in pairs; rate: strides/s of the reference. The lag of a
    foot is the shift within +- half a stride where its cross-correlation with the reference peaks.
    """
    if not len(windows) or not np.isfinite(rate):
        return float("nan"), float("nan")
    reach = max(1, int(0.5 / (rate * dt)))
    lags = [
        abs(lag(window[:, x], reference[:, x], reach)) * dt
        for window, reference in zip(windows, reference_windows, strict=True)
        for x in (LEFT_X, RIGHT_X)
    ]
    seconds = float(np.mean(lags))
    return seconds, seconds * rate


def describe(gait: Gait, *, target_speed: float, mass: float | None = None, hops: bool = False) -> dict[str, float]:
    """One row of gait.csv: every metric of this file that the recording allows, nan elsewhere; names carry units.

    Mean speed and its error count from the reset, everything else the steady part (`steady_steps`). hops: it is one
    with both feet.
    """
    nan = float("nan")
    features, dt = gait.features, gait.dt
    valid = steady_steps(gait.valid, dt)
    row: dict[str, float] = {
        "episodes": len(features),
        "falls": int(gait.fallen.sum()),
        "target_speed_m_per_s": target_speed,
    }
    speed = steady = error = duty = phase = nan
    contact = gait.contact
    if gait.velocity is not None:
        speed, steady = mean_speed(gait.velocity, gait.valid), mean_speed(gait.velocity, valid)
        error = 100.0 * abs(speed - target_speed) / target_speed if target_speed > 0 else nan
        if contact is None:
            contact = infer_contact(features, gait.velocity, dt, gait.valid)
    if contact is not None:
        duty, phase = duty_factor(contact, valid), touchdown_phase(contact, valid)
    row |= {
        "mean_speed_m_per_s": speed,
        "steady_speed_m_per_s": steady,
        "speed_error_percent": error,
        "stride_frequency_hz": stride_frequency(features, dt, valid, hops=hops),
        "duty_factor": duty,
        "left_right_correlation": left_right_correlation(features, valid),
        "left_right_symmetry": left_right_symmetry(features, dt, valid),
        "touchdown_phase_strides": phase,
        "pelvis_height_m": body_height(features, valid),
        "pelvis_excursion_m": body_excursion(features, dt, valid, hops=hops),
        "trunk_lean_deg": nan if gait.trunk_lean is None else trunk_lean_degrees(gait.trunk_lean, valid),
    }
    return row | describe_energy(gait, valid, mass) | describe_loads(gait.loads, valid, dt)


def describe_energy(gait: Gait, valid: Bools, mass: float | None) -> dict[str, float]:
    """ENERGY_MEASURES, nan where power was not recorded; those without retraction are of a walker that has one.

    mass: of the walker, kg.
    """
    row = dict.fromkeys(ENERGY_MEASURES, float("nan"))
    if mass is None:
        return row
    cost, own_cost, power, own_power = ENERGY_MEASURES
    if gait.power is not None and gait.velocity is not None:
        row[cost] = cost_of_transport(gait.power, gait.velocity, mass, valid)
        if gait.retraction_power is not None:
            row[own_cost] = cost_of_transport(gait.power - gait.retraction_power, gait.velocity, mass, valid)
    if gait.positive_power is not None:
        row[power] = _masked_mean(gait.positive_power, valid) / mass
        if gait.positive_retraction_power is not None:
            row[own_power] = _masked_mean(gait.positive_power - gait.positive_retraction_power, valid) / mass
    return row


def _episodes(values: NDArray[Scalar], valid: Bools | None) -> Iterator[NDArray[Scalar]]:
    """The valid steps of each episode."""
    for index, episode in enumerate(values):
        yield episode if valid is None else episode[valid[index]]


def _without_gaps(contact: Bools) -> Bools:
    """Contact (T,) with gaps of one step closed."""
    closed = contact.copy()
    closed[1:-1] |= contact[:-2] & contact[2:]
    return closed


def _masked_mean(values: Floats, valid: Bools | None) -> float:
    mask = np.ones(values.shape, bool) if valid is None else valid
    return float(values[mask].mean()) if mask.any() else float("nan")


def _nanmean(values: list[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.mean(finite)) if finite else float("nan")


def _nanmedian(values: list[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.median(finite)) if finite else float("nan")
