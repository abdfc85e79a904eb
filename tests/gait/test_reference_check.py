"""The check of the reference: a good gait passes, each defect is refused by its name."""

import dataclasses

import numpy as np
import pytest

from romgrl.config.teachers import GAITS
from romgrl.errors import ArtifactError
from romgrl.gait.features import Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.reference_check import check_reference, largest_trend, slip_speeds

SPEED, DT, STRIDE, DUTY, EPISODES, STEPS = 4.0, 1.0 / 30.0, 0.6, 0.3, 4, 200


def runner(phase_between_feet: float = 0.5) -> Gait:
    """A runner worked out from its definition: feet fixed to the ground in stance, the body a cosine."""
    time = DT * np.arange(STEPS) + 0.1 * np.arange(EPISODES)[:, None]
    features = np.zeros((EPISODES, STEPS, 5))
    contact = np.zeros((EPISODES, STEPS, 2), bool)
    features[..., 0] = 0.9 + 0.04 * np.cos(4 * np.pi * time / STRIDE)
    reach = 0.5 * SPEED * DUTY * STRIDE
    for foot in range(2):
        phase = (time / STRIDE + foot * phase_between_feet) % 1.0
        stance = phase < DUTY
        back = reach - SPEED * STRIDE * phase
        forward = -reach * np.cos(np.pi * (phase - DUTY) / (1 - DUTY))
        features[..., 1 + 2 * foot] = np.where(stance, back, forward)
        lift = 0.2 * np.sin(np.pi * (phase - DUTY) / (1 - DUTY)) * ~stance
        features[..., 2 + 2 * foot] = 0.07 - features[..., 0] + lift
        contact[..., foot] = stance
    velocity = np.full((EPISODES, STEPS), SPEED)
    valid = np.ones((EPISODES, STEPS), bool)
    return Gait(features, valid, np.zeros(EPISODES, bool), DT, velocity=velocity, contact=contact)


def test_good_reference_passes_with_its_numbers() -> None:
    measured = check_reference(runner())
    assert measured["falls"] == 0
    assert measured["left_right_correlation"] < -0.8
    assert measured["slip"] == pytest.approx(0.0, abs=1e-9)
    assert measured["lowest_body"] == pytest.approx(0.86 / 0.9, abs=0.01)
    assert measured["speed_trend"] == pytest.approx(0.0, abs=1e-9)
    assert measured["height_trend"] < 0.02


def test_terminated_episode_is_a_fall() -> None:
    gait = runner()
    gait.fallen[2] = True
    with pytest.raises(ArtifactError, match=r"falls: in 1 of 4 episodes, limit 0"):
        check_reference(gait)


def test_body_on_the_ground_is_a_fall() -> None:
    gait = runner()
    gait.features[1, 150:, 0] = 0.45
    with pytest.raises(ArtifactError, match=r"falls: lowest body height 0\.\d+ of the median, limit 0\.7"):
        check_reference(gait)


def test_two_legged_hop_is_refused() -> None:
    with pytest.raises(ArtifactError, match=r"hops: left-right correlation of foot x 1\.00, limit -0\.5"):
        check_reference(runner(phase_between_feet=0.0))


def test_still_feet_are_no_gait() -> None:
    gait = runner()
    gait.features[..., 1:] = 0.0
    with pytest.raises(ArtifactError, match="hops"):
        check_reference(gait)


def test_sliding_foot_is_refused() -> None:
    gait = dataclasses.replace(runner(), velocity=np.full((EPISODES, STEPS), SPEED + 1.5))
    with pytest.raises(ArtifactError, match=r"slides: .* 1\.50 m/s, limit 0\.55"):
        check_reference(gait)


def test_reference_without_stance_is_refused() -> None:
    gait = dataclasses.replace(runner(), contact=np.zeros((EPISODES, STEPS, 2), bool))
    with pytest.raises(ArtifactError, match=r"flies: no foot is on the ground for 100\.0% of the time, limit 80%"):
        check_reference(gait)


def test_each_gait_has_its_own_footfall() -> None:
    """A run (a third of it in the air) is no walk and no hop; feet together are a hop where one is asked for."""
    run, hop = runner(), runner(phase_between_feet=0.0)
    with pytest.raises(ArtifactError, match=r"flies: .* for 33\.\d% of the time, limit 2%"):
        check_reference(run, FOOTFALLS["walk"])
    other = r"another footfall: the right foot lands at 0\.50 of the left one's stride, needed: "
    with pytest.raises(ArtifactError, match=other + r"0 ± 0\.1"):
        check_reference(run, FOOTFALLS["hop"])
    with pytest.raises(ArtifactError, match=other + r"0\.3 ± 0\.12"):
        check_reference(run, FOOTFALLS["skip"])
    check_reference(runner(phase_between_feet=0.7), FOOTFALLS["skip"])  # the right foot lands 0.3 after the left one
    measured = check_reference(hop, FOOTFALLS["hop"])
    assert measured["left_right_correlation"] == pytest.approx(1.0)
    assert measured["flight"] == pytest.approx(2 / 3, abs=0.01)
    assert hop.contact is not None
    hop.contact[:] = True
    with pytest.raises(ArtifactError, match=r"hardly flies: for 0\.0% of the time, at least 10%"):
        check_reference(hop, FOOTFALLS["hop"])
    assert FOOTFALLS.keys() == set(GAITS)


def test_a_hop_on_the_spot_is_judged_by_half_a_metre_per_second() -> None:
    gait = runner(phase_between_feet=0.0)
    feet = gait.features[:, :, [1, 3]].mean(axis=(0, 1))
    gait.features[..., [1, 3]] = feet
    still = dataclasses.replace(gait, velocity=np.tile(np.linspace(-0.05, 0.05, STEPS), (EPISODES, 1)))
    still.features[..., [1, 3]] += 0.001 * np.sin(np.arange(STEPS))[:, None]
    with pytest.raises(ArtifactError, match=r"drifts: speed changes by 20% across an episode"):
        check_reference(still, FOOTFALLS["hop"])


@pytest.mark.parametrize("phase", [0.34, 0.37])
def test_feet_that_land_out_of_turn_are_no_run(phase: float) -> None:
    with pytest.raises(ArtifactError, match=r"another footfall: .* needed: 0\.5 ± 0\.12"):
        check_reference(runner(phase))


def test_a_foot_that_never_lands_is_no_run() -> None:
    gait = runner()
    assert gait.contact is not None
    gait.contact[..., 1] = False
    with pytest.raises(ArtifactError, match=r"another footfall: the right foot lands at nan of the left one's stride"):
        check_reference(gait)


def test_a_foot_that_is_dragged_forward_is_no_stance() -> None:
    """The left one touches the ground in its swing, too, but for the last four steps before it lands."""
    gait = runner()
    assert gait.contact is not None
    contact = gait.contact.copy()
    soon = np.stack([np.roll(contact[..., 0], -steps, axis=1) for steps in (1, 2, 3, 4)]).any(axis=0)
    contact[..., 0] |= ~soon
    with pytest.raises(ArtifactError, match=r"slides: in \d\d% of the steps on the ground a foot moves faster than 0"):
        check_reference(dataclasses.replace(gait, contact=contact))


def test_speed_drift_is_refused() -> None:
    gait = runner()
    assert gait.velocity is not None
    gait.velocity[3] *= np.linspace(0.9, 1.1, STEPS)
    with pytest.raises(ArtifactError, match=r"drifts: speed changes by 20% across an episode, limit 15%"):
        check_reference(gait)


def test_height_drift_is_refused() -> None:
    gait = runner()
    gait.features[0, :, 0] += np.linspace(0.0, 0.09, STEPS)
    with pytest.raises(ArtifactError, match=r"drifts: body height changes by (9|10|11)% across an episode, limit 5%"):
        check_reference(gait)


def test_check_needs_velocity_and_contact() -> None:
    with pytest.raises(ValueError, match="contacts"):
        check_reference(dataclasses.replace(runner(), contact=None))


def test_trend_is_the_change_along_the_fitted_line() -> None:
    values = np.array([[1.0, 2.0, 3.0, 100.0], [5.0, 5.0, 5.0, 5.0]])
    valid = np.array([[True, True, True, False], [True] * 4])
    assert largest_trend(values, valid) == pytest.approx(2.0)


def test_slip_of_a_foot_that_stays_behind() -> None:
    features = np.zeros((1, 3, 5))
    features[0, :, 1] = [0.3, 0.2, 0.1]
    contact = np.array([[[True, False]] * 3])
    slips = slip_speeds(features, contact, np.full((1, 3), 1.5), 0.1, np.ones((1, 3), bool))
    assert np.median(slips) == pytest.approx(0.5)


def test_bounces_that_are_cut_are_no_drift() -> None:
    """Nine jumps of 0.8 m have a fitted slope of their own; one that gets higher drifts all the same."""
    step = np.arange(250)
    bounces = (0.9 + 0.4 * np.sin(2 * np.pi * 9.0 * step / 250))[None]
    valid = np.ones(bounces.shape, bool)
    assert largest_trend(bounces, valid) > 0.05
    assert largest_trend(bounces, valid, window=36) < 0.02
    assert largest_trend(bounces + 0.2 * step / 250, valid, window=36) == pytest.approx(0.17, abs=0.04)
    assert largest_trend(bounces, np.zeros(bounces.shape, bool), window=36) == 0.0
