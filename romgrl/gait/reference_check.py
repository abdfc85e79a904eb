"""Is a reference fit to be imitated? It must not fall, have another footfall than asked, slide or drift."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from romgrl.errors import ArtifactError
from romgrl.gait.features import BODY_Y, LEFT_X, RIGHT_X, Bools, Floats, Gait
from romgrl.gait.footfall import FOOTFALLS, Footfall
from romgrl.gait.metrics import left_right_correlation, touchdown_phase

LARGEST_SLIP = 0.1  # of the mean speed; feet that stick show 0.01 to 0.02, the error of differences over a step
SLOWEST_SLIP_LIMIT = 0.2  # m/s, for slow gaits
LARGEST_SLIPPING = 0.15  # of the steps of contact, beyond these limits; fit teachers show up to 0.07
LARGEST_OFF = 0.12  # strides, of the right foot's touchdown from where the gait has it; fit runs and walks show 0.04
LARGEST_SPEED_TREND = 0.15  # of the mean speed, from the start of an episode to its end; teachers show 0.04 to 0.11
SLOWEST_TREND = 0.5  # m/s, of which a trend is a share in gaits that are slower
LONGEST_BOUNCE = 1.2  # s
LARGEST_HEIGHT_TREND = 0.05  # of the mean body height


def check_reference(gait: Gait, footfall: Footfall = FOOTFALLS["run"]) -> dict[str, float]:
    """The measured numbers of a fit reference; ArtifactError with the number and its limit for any other.

    `gait` needs velocity and contact, and its valid steps should be the steady part only.
    """
    if gait.velocity is None or gait.contact is None:
        raise ValueError("a reference is checked on its velocity and its contacts, too")
    measured = {"falls": float(gait.fallen.sum())}
    if measured["falls"] > 0:
        raise ArtifactError(f"the reference falls: in {measured['falls']:.0f} of {len(gait.fallen)} episodes, limit 0")
    measured["lowest_body"] = lowest_body(gait)
    if not measured["lowest_body"] >= footfall.lowest:
        raise ArtifactError(
            f"the reference falls: lowest body height {measured['lowest_body']:.2f} of the median, "
            f"limit {footfall.lowest}"
        )
    measured |= check_footfall(gait, footfall)
    speed = float(np.abs(gait.velocity[gait.valid].mean()))
    slip_limit = max(LARGEST_SLIP * speed, SLOWEST_SLIP_LIMIT)
    slips = slip_speeds(gait.features, gait.contact, gait.velocity, gait.dt, gait.valid)
    measured["slip"] = float(np.median(slips)) if len(slips) else float("nan")
    if not measured["slip"] <= slip_limit:
        raise ArtifactError(
            f"the reference slides: the foot on the ground moves at {measured['slip']:.2f} m/s, limit {slip_limit:.2f}"
        )
    measured["slipping"] = float((slips > slip_limit).mean())
    if measured["slipping"] > LARGEST_SLIPPING:
        raise ArtifactError(
            f"the reference slides: in {measured['slipping']:.0%} of the steps on the ground a foot moves faster than "
            f"{slip_limit:.2f} m/s, limit {LARGEST_SLIPPING:.0%}"
        )
    measured["speed_trend"] = largest_trend(gait.velocity, gait.valid) / max(speed, SLOWEST_TREND)
    if not measured["speed_trend"] <= LARGEST_SPEED_TREND:
        raise ArtifactError(
            f"the reference drifts: speed changes by {measured['speed_trend']:.0%} across an episode, "
            f"limit {LARGEST_SPEED_TREND:.0%}"
        )
    height = gait.features[..., BODY_Y]
    window = round(LONGEST_BOUNCE / gait.dt) if footfall.together else 1
    measured["height_trend"] = largest_trend(height, gait.valid, window) / float(height[gait.valid].mean())
    if not measured["height_trend"] <= LARGEST_HEIGHT_TREND:
        raise ArtifactError(
            f"the reference drifts: body height changes by {measured['height_trend']:.0%} across an episode, "
            f"limit {LARGEST_HEIGHT_TREND:.0%}"
        )
    return measured


def check_footfall(gait: Gait, footfall: Footfall) -> dict[str, float]:
    """How feet move together, and the share of the time with none on the ground; ArtifactError for another gait's."""
    assert gait.contact is not None
    correlation, least, most = left_right_correlation(gait.features, gait.valid), *footfall.flight
    if not correlation <= footfall.correlation:
        told = f"left-right correlation of foot x {correlation:.2f}"
        raise ArtifactError(f"the reference hops: {told}, limit {footfall.correlation:g}")
    flight = 1.0 - float(np.any(gait.contact[gait.valid], axis=1).mean())
    if flight > most:
        told = f"no foot is on the ground for {flight:.1%} of the time"
        raise ArtifactError(f"the reference flies: {told}, limit {most:.0%}")
    if flight < least:
        raise ArtifactError(f"the reference hardly flies: for {flight:.1%} of the time, at least {least:.0%}")
    phase = touchdown_phase(gait.contact, gait.valid)
    allowed = min(footfall.off, LARGEST_OFF)
    if not abs((phase - footfall.phase + 0.5) % 1.0 - 0.5) <= allowed:
        told = f"the right foot lands at {phase:.2f} of the left one's stride"
        raise ArtifactError(f"the reference has another footfall: {told}, needed: {footfall.phase:g} ± {allowed:g}")
    return {"left_right_correlation": correlation, "flight": flight}


def lowest_body(gait: Gait) -> float:
    """Lowest body height over the median one."""
    height = gait.features[..., BODY_Y][gait.valid]
    return float(height.min() / np.median(height))


def slip_speeds(features: Floats, contact: Bools, velocity: Floats, dt: float, valid: Bools) -> Floats:
    """Speeds over the ground |dx_foot/dt + v| of feet that are in contact before and after a step (n,), m/s.

    features (E, T, 5), contact (E, T, 2), velocity (E, T) m/s, valid (E, T); none where no foot stays in contact.
    """
    slips = []
    both = valid[:, 1:] & valid[:, :-1]
    body = 0.5 * (velocity[:, 1:] + velocity[:, :-1])
    for foot, x in enumerate((LEFT_X, RIGHT_X)):
        moved = np.diff(features[..., x], axis=1) / dt + body
        stance = both & contact[:, 1:, foot] & contact[:, :-1, foot]
        slips.append(np.abs(moved[stance]))
    return np.concatenate(slips)


def largest_trend(values: Floats, valid: Bools, window: int = 1) -> float:
    """Change along the fitted line from start to end of an episode, largest over episodes. values, valid: (E, T).

    window: of the highest value in so many steps: a bounce that is cut has a slope of its own.
    """
    trends = []
    for episode, mask in zip(values, valid, strict=True):
        kept = episode[mask]
        if 1 < window <= len(kept):
            kept = sliding_window_view(kept, window).max(axis=-1)
        steps = np.arange(len(kept)) - 0.5 * (len(kept) - 1)
        trends.append(abs(float(steps @ kept)) / float(steps @ steps) * (len(kept) - 1) if len(kept) > 1 else 0.0)
    return max(trends)
