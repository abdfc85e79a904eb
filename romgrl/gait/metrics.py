"""A gait in numbers. Free functions on arrays: features (E, T, 5) m, contact (E, T, 2), velocity (E, T) m/s, dt s.

`valid` (E, T) marks the steps that count, as one run from each episode's start (None: all); what follows a fall never counts.
Every function averages over episodes and returns nan where no episode is long enough to tell.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from romgrl.gait.features import BODY_Y, LEFT_X, LEFT_Z, RIGHT_X, RIGHT_Z, Bools, Floats, Gait

GRAVITY = 9.81
SLOWEST_STRIDE, FASTEST_STRIDE = 0.3, 5.0  # strides/s, the band searched
SETTLING_TIME = 2.0  # s from reset until a gait is called steady


def falls(upright: Bools) -> int:
    """Episodes with at least one step that is not upright. upright: (E, T)."""
    return int((~upright.all(axis=1)).sum())


def mean_speed(velocity: Floats, valid: Bools | None = None, skip: int = 0) -> float:
    """Mean forward speed over all valid steps after the first `skip` of each episode, m/s."""
    return _masked_mean(velocity, valid, skip)


def speed_error(velocity: Floats, target: float, valid: Bools | None = None, skip: int = 0) -> float:
    """Mean of |v - target| over the valid steps, m/s."""
    return _masked_mean(np.abs(velocity - target), valid, skip)


def stride_frequency(features: Floats, dt: float, valid: Bools | None = None) -> float:
    """Strides per second from the autocorrelation of both feet's x; median over episodes.

    The period is the earliest autocorrelation peak that reaches 0.8 of the highest one within 0.2-3.3 s (so that no multiple is
    taken for the stride), refined at the last multiple inside half the episode. A stride is two steps, touchdown to touchdown
    of the same foot (Winter, Biomechanics and Motor Control of Human Movement, ch. 3).
    """
    rates = [_episode_stride_frequency(e[:, [LEFT_X, RIGHT_X]], dt) for e in _episodes(features, valid)]
    return _nanmedian(rates)


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

    Largest over one stride of time shifts of Lin's concordance correlation 2 cov / (var_L + var_R + (mean_L - mean_R)^2)
    (Lin 1989, Biometrics 45:255) of left and right foot x; differences of timing, amplitude and offset all lower it.
    """
    values = []
    for episode in _episodes(features, valid):
        rate = _episode_stride_frequency(episode[:, [LEFT_X, RIGHT_X]], dt)
        if np.isfinite(rate):
            shifts = np.arange(0.0, 1.0 / (rate * dt), 0.25)
            left, right = episode[:, LEFT_X], episode[:, RIGHT_X]
            values.append(max(_concordance(left, right, shift) for shift in shifts))
    return _nanmean(values)


def body_height(features: Floats, valid: Bools | None = None) -> float:
    """Mean height of the body above the ground, m."""
    return _masked_mean(features[..., BODY_Y], valid)


def body_excursion(features: Floats, dt: float, valid: Bools | None = None) -> float:
    """Highest minus lowest body height within a stride, mean over strides, m."""
    values = []
    for episode in _episodes(features, valid):
        rate = _episode_stride_frequency(episode[:, [LEFT_X, RIGHT_X]], dt)
        if np.isfinite(rate):
            length = round(1.0 / (rate * dt))
            strides = episode[: len(episode) // length * length, BODY_Y].reshape(-1, length)
            values.append(float(np.ptp(strides, axis=1).mean()))
    return _nanmean(values)


def trunk_lean_degrees(trunk_lean: Floats, valid: Bools | None = None) -> float:
    """Mean inclination of the trunk in degrees, forward positive. trunk_lean: (E, T) rad."""
    return float(np.degrees(_masked_mean(trunk_lean, valid)))


def cost_of_transport(power: Floats, velocity: Floats, mass: float, valid: Bools | None = None) -> float:
    """Mechanical cost of transport: sum |torque x omega| dt / (m g d), d = sum v dt (Collins et al. 2005, Science 307:1082).

    power: (E, T) W, summed over joints. nan where the walker does not move forward.
    """
    speed = _masked_mean(velocity, valid)
    return _masked_mean(power, valid) / (mass * GRAVITY * speed) if speed > 1e-3 else float("nan")


def infer_contact(features: Floats, velocity: Floats, dt: float, valid: Bools | None = None) -> Bools:
    """Feet on the ground, guessed from motion alone: the ankle is low and nearly still over the ground.

    Low: within 6 cm of the 2nd percentile of that ankle's height; still: |v + d x_foot / dt| below 0.3 m/s or 40% of the mean
    speed. For walkers that record no contact forces. Shape of the result: (E, T, 2), left and right.
    """
    contact = np.zeros((*features.shape[:2], 2), bool)
    limit = max(0.3, 0.4 * abs(np.nan_to_num(_masked_mean(velocity, valid))))
    for index, episode in enumerate(_episodes(features, valid)):
        if len(episode) < 3:
            continue
        for foot, (x, z) in enumerate(((LEFT_X, LEFT_Z), (RIGHT_X, RIGHT_Z))):
            height = episode[:, BODY_Y] + episode[:, z]
            sliding = velocity[index, : len(episode)] + np.gradient(episode[:, x], dt)
            contact[index, : len(episode), foot] = (height < np.percentile(height, 2) + 0.06) & (
                np.abs(sliding) < limit
            )
    return contact


def touchdowns(contact: Bools) -> list[int]:
    """Steps at which one foot lands. contact: (T,). Gaps of a single step are closed first: at 30 Hz they are chatter."""
    closed = contact.copy()
    closed[1:-1] |= contact[:-2] & contact[2:]
    return (np.flatnonzero(closed[1:] & ~closed[:-1]) + 1).tolist()


def duty_factor(contact: Bools, valid: Bools | None = None) -> float:
    """Share of a stride that a foot is on the ground, mean over feet: below 0.5 running (Alexander 1989, Physiol. Rev. 69:1199).

    Counted over whole strides, first to last touchdown of each foot; over all steps where a foot lands less than twice.
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
        for start, stop in zip(left[:-1], left[1:], strict=True):
            phases += [(landing - start) / (stop - start) for landing in right if start <= landing < stop]
    if not phases:
        return float("nan")
    return float(np.angle(np.exp(2j * np.pi * np.asarray(phases)).mean()) / (2 * np.pi) % 1.0)


def phase_lag(windows: Floats, reference_windows: Floats, dt: float, frequency: float) -> tuple[float, float]:
    """Time that the feet's x stay behind the reference after the common alignment: (seconds, strides), mean of |lag|.

    windows, reference_windows: (E, W, 5), already aligned in pairs; frequency: strides/s of the reference. The lag of a foot is
    the shift within +- half a stride at which its cross-correlation with the reference peaks (parabola through the peak).
    """
    if not len(windows) or not np.isfinite(frequency):
        return float("nan"), float("nan")
    reach = max(1, int(0.5 / (frequency * dt)))
    lags = []
    for window, reference in zip(windows, reference_windows, strict=True):
        for x in (LEFT_X, RIGHT_X):
            a, b = window[:, x] - window[:, x].mean(), reference[:, x] - reference[:, x].mean()
            shifts = np.arange(-reach, reach + 1)
            score = np.array([_overlap_correlation(a, b, int(shift)) for shift in shifts])
            best = int(score.argmax())
            lags.append(abs(shifts[best] + _parabola(score, best)) * dt)
    seconds = float(np.mean(lags))
    return seconds, seconds * frequency


def describe(gait: Gait, *, target_speed: float, mass: float | None = None) -> dict[str, float]:
    """One row of gait.csv: every metric of this file that the recording allows, nan elsewhere; names carry the units."""
    nan = float("nan")
    features, valid, dt = gait.features, gait.valid, gait.dt
    row: dict[str, float] = {
        "episodes": len(features),
        "falls": int(gait.fallen.sum()),
        "target_speed_m_per_s": target_speed,
    }
    speed = steady = error = cost = duty = phase = nan
    contact = gait.contact
    if gait.velocity is not None:
        skip = min(round(SETTLING_TIME / dt), features.shape[1] // 2)
        speed, steady = mean_speed(gait.velocity, valid), mean_speed(gait.velocity, valid, skip)
        error = 100.0 * abs(speed - target_speed) / target_speed if target_speed > 0 else nan
        if contact is None:
            contact = infer_contact(features, gait.velocity, dt, valid)
        if gait.power is not None and mass is not None:
            cost = cost_of_transport(gait.power, gait.velocity, mass, valid)
    if contact is not None:
        duty, phase = duty_factor(contact, valid), touchdown_phase(contact, valid)
    row |= {
        "mean_speed_m_per_s": speed,
        "steady_speed_m_per_s": steady,
        "speed_error_percent": error,
        "stride_frequency_hz": stride_frequency(features, dt, valid),
        "duty_factor": duty,
        "left_right_correlation": left_right_correlation(features, valid),
        "left_right_symmetry": left_right_symmetry(features, dt, valid),
        "touchdown_phase_strides": phase,
        "pelvis_height_m": body_height(features, valid),
        "pelvis_excursion_m": body_excursion(features, dt, valid),
        "trunk_lean_deg": nan if gait.trunk_lean is None else trunk_lean_degrees(gait.trunk_lean, valid),
        "cost_of_transport": cost,
    }
    return row


def _episodes(values: Floats | Bools, valid: Bools | None) -> Iterator[Floats | Bools]:
    """The valid steps of each episode."""
    for index, episode in enumerate(values):
        yield episode if valid is None else episode[valid[index]]


def _masked_mean(values: Floats, valid: Bools | None, skip: int = 0) -> float:
    mask = np.ones(values.shape, bool) if valid is None else valid.copy()
    mask[:, :skip] = False
    return float(values[mask].mean()) if mask.any() else float("nan")


def _episode_stride_frequency(feet: Floats, dt: float) -> float:
    """Strides/s of one episode's foot motion (T, F), nan where nothing repeats."""
    steps = len(feet)
    shortest, longest = (
        max(2, int(1.0 / (FASTEST_STRIDE * dt))),
        min(int(1.0 / (SLOWEST_STRIDE * dt)), int(0.75 * steps)),
    )
    centred = feet - feet.mean(axis=0)
    if longest - shortest < 3 or centred.std() < 1e-6:
        return float("nan")
    spectrum = np.fft.rfft(centred, 2 * steps, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:steps].sum(axis=1) / np.arange(steps, 0, -1)
    correlation /= correlation[0]
    inner = np.arange(shortest, longest)
    peaks = inner[(correlation[inner] >= correlation[inner - 1]) & (correlation[inner] > correlation[inner + 1])]
    peaks = peaks[correlation[peaks] > 0.3]
    if not len(peaks):
        return float("nan")
    first = int(peaks[correlation[peaks] >= 0.8 * correlation[peaks].max()][0])
    period = first + _parabola(correlation, first)
    for multiple in range(2, int(0.5 * steps / period) + 1):
        centre = round(multiple * period)
        near = np.arange(max(centre - first // 4, 1), min(centre + first // 4 + 1, steps - 1))
        best = int(near[correlation[near].argmax()])
        period = (best + _parabola(correlation, best)) / multiple
    return 1.0 / (period * dt)


def _parabola(values: Floats, index: int) -> float:
    """Offset in (-0.5, 0.5) of the vertex of the parabola through a peak and its neighbours."""
    if not 0 < index < len(values) - 1:
        return 0.0
    left, centre, right = values[index - 1 : index + 2]
    curvature = left - 2 * centre + right
    return float(np.clip(0.5 * (left - right) / curvature, -0.5, 0.5)) if curvature < 0 else 0.0


def _concordance(left: Floats, right: Floats, shift: float) -> float:
    """Lin's concordance of left(t) with right(t + shift), shift in steps, linear interpolation."""
    times = np.arange(len(left) - int(np.ceil(shift)))
    a, b = left[times], np.interp(times + shift, np.arange(len(right)), right)
    scale = a.var() + b.var() + (a.mean() - b.mean()) ** 2
    return float(2 * ((a - a.mean()) * (b - b.mean())).mean() / scale) if scale > 1e-12 else 1.0


def _overlap_correlation(a: Floats, b: Floats, shift: int) -> float:
    """Correlation of a(t + shift) with b(t) over the steps they share."""
    first, second = (a[shift:], b[: len(b) - shift]) if shift >= 0 else (a[:shift], b[-shift:])
    norm = np.sqrt((first**2).sum() * (second**2).sum())
    return float((first * second).sum() / norm) if norm > 1e-12 else 0.0


def _nanmean(values: list[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.mean(finite)) if finite else float("nan")


def _nanmedian(values: list[float]) -> float:
    finite = [v for v in values if np.isfinite(v)]
    return float(np.median(finite)) if finite else float("nan")
