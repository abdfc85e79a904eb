from dataclasses import replace

import numpy as np
import pytest

from romgrl.gait import human_bands, metrics
from romgrl.gait.features import BODY_Y, POWERS, Gait, GaitLoads
from romgrl.gait.jumps import JUMP_MEASURES
from romgrl.gait.load_metrics import LOAD_MEASURES
from romgrl.gait.measures import MEASURES
from tests.helpers.synthetic_gait import DT, run


@pytest.mark.parametrize("frequency", [0.8, 1.0, 1.73, 2.55, 3.4])
def test_stride_frequency_of_a_sine_gait(frequency: float) -> None:
    features, _ = run(frequency=frequency, noise=0.02)
    assert metrics.stride_frequency(features, DT) == pytest.approx(frequency, rel=0.005)


def test_stride_frequency_is_not_fooled_by_a_hop_or_a_short_episode() -> None:
    hop, _ = run(frequency=1.5, right_phase=0.0)
    assert metrics.stride_frequency(hop, DT) == pytest.approx(1.5, rel=0.005)
    short, _ = run(frequency=1.5, steps=60)
    assert metrics.stride_frequency(short, DT) == pytest.approx(1.5, rel=0.03)
    assert np.isnan(metrics.stride_frequency(np.zeros((2, 300, 5)), DT))
    assert np.isnan(metrics.stride_frequency(short[:, :5], DT))


def test_hops_on_the_spot_are_counted_by_the_bounces_of_the_body() -> None:
    hop = np.zeros((2, 300, 5))
    hop[..., BODY_Y] = 0.9 + 0.1 * np.cos(2 * np.pi * 2.1 * DT * np.arange(300))
    assert np.isnan(metrics.stride_frequency(hop, DT))
    assert metrics.stride_frequency(hop, DT, hops=True) == pytest.approx(2.1, rel=0.005)
    assert np.isnan(metrics.body_excursion(hop, DT))
    assert metrics.body_excursion(hop, DT, hops=True) == pytest.approx(0.2, abs=0.01)


def test_stride_frequency_counts_strides_of_different_length() -> None:
    # every third swing is twice as long: the pattern repeats at 0.6 Hz, the foot swings at 1.8 Hz
    time = DT * np.arange(300)
    features = np.zeros((1, 300, 5))
    features[0, :, 1] = 0.3 * np.cos(2 * np.pi * 1.8 * time) + 0.15 * np.cos(2 * np.pi * 0.6 * time)
    features[0, :, 3] = features[0, ::-1, 1]
    assert metrics.stride_frequency(features, DT) == pytest.approx(1.8, rel=0.01)


def test_standing_is_no_stride() -> None:
    features, _ = run(amplitude=0.005)
    assert np.isnan(metrics.stride_frequency(features, DT))


@pytest.mark.parametrize("duty", [0.28, 0.62])
def test_duty_factor_and_touchdown_phase(duty: float) -> None:
    for phase in (0.5, 0.42, 0.0):
        _, contact = run(duty=duty, right_phase=phase, episodes=16)
        assert metrics.duty_factor(contact) == pytest.approx(duty, abs=0.02)
        difference = (metrics.touchdown_phase(contact) - phase + 0.5) % 1.0 - 0.5
        assert abs(difference) < 0.02


def test_touchdowns_close_single_gaps() -> None:
    contact = np.array([0, 1, 1, 0, 1, 0, 0, 0, 1, 1], bool)
    assert metrics.touchdowns(contact) == [1, 8]


def test_a_toe_that_scuffs_in_its_swing_has_not_landed() -> None:
    """Feet that alternate, both with a scuff three steps after they lift: without the stance's length it is a hop."""
    stride = np.array([1, 1, 1, 1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0], bool)
    left = np.tile(stride, 20)
    contact = np.stack([left, np.roll(left, 9)], axis=-1)[None]
    assert set(np.diff(metrics.touchdowns(left))) == {18}
    assert metrics.touchdown_phase(contact) == pytest.approx(0.5, abs=1e-9)


def test_left_right_correlation_is_the_cosine_of_the_phase() -> None:
    for phase, expected in ((0.5, -1.0), (0.0, 1.0), (0.25, 0.0)):
        features, _ = run(right_phase=phase)
        assert metrics.left_right_correlation(features) == pytest.approx(expected, abs=0.02)


def test_symmetry_is_one_for_equal_feet_and_falls_with_amplitude() -> None:
    features, _ = run()
    assert metrics.left_right_symmetry(features, DT) > 0.995
    features[..., 3] *= 0.5
    # 2 cov / (var + var) = 2 (a b / 2) / (a^2/2 + b^2/2) with b = a/2: 0.8
    assert metrics.left_right_symmetry(features, DT) == pytest.approx(0.8, abs=0.01)


def test_body_height_and_excursion() -> None:
    features, _ = run(height=0.91, excursion=0.07, frequency=1.5)
    assert metrics.body_height(features) == pytest.approx(0.91, abs=1e-3)
    assert metrics.body_excursion(features, DT) == pytest.approx(0.07, abs=2e-3)


def test_speed_lean_and_cost_skip_what_follows_a_fall() -> None:
    velocity = np.full((2, 100), 4.0)
    velocity[0, 50:] = -100.0
    valid = np.ones((2, 100), bool)
    valid[0, 50:] = False
    assert metrics.falls(valid) == 1
    assert metrics.mean_speed(velocity, valid) == 4.0
    assert metrics.trunk_lean_degrees(np.where(valid, np.pi / 18, 9.0), valid) == pytest.approx(10.0)
    # 700 W at 4 m/s and 70 kg: 700 / (70 x 9.81 x 4)
    cost = metrics.cost_of_transport(np.where(valid, 700.0, 1e6), velocity, 70.0, valid)
    assert cost == pytest.approx(700 / (70 * 9.81 * 4))
    assert np.isnan(metrics.cost_of_transport(velocity, 0 * velocity, 70.0))


def test_inferred_contact_of_a_rolling_foot() -> None:
    # stance: the foot is on the ground and moves back at exactly the walking speed; swing: forward and 15 cm up
    steps, period, speed = 300, 20, 2.0
    phase = np.arange(steps) % period
    stance = phase < 8
    x = np.where(stance, 0.25 - speed * DT * phase, -0.25 + 0.5 * (phase - 8) / 12)
    lift = np.where(stance, 0.0, 0.15 * np.sin(np.pi * (phase - 7.5) / 12.5))
    features = np.zeros((1, steps, 5))
    features[0, :, 0] = 0.9
    features[0, :, 1], features[0, :, 3] = x, np.roll(x, 10)
    features[0, :, 2], features[0, :, 4] = -0.83 + lift, -0.83 + np.roll(lift, 10)
    contact = metrics.infer_contact(features, np.full((1, steps), speed), DT)
    assert metrics.duty_factor(contact) == pytest.approx(0.4, abs=0.11)
    assert metrics.touchdown_phase(contact) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("shift", [-0.08, 0.0, 0.05])
def test_phase_lag_of_a_shifted_sine(shift: float) -> None:
    time = DT * np.arange(100)
    teacher, student = (np.zeros((1, 100, 5)) for _ in range(2))
    for foot in (1, 3):
        teacher[0, :, foot] = np.sin(2 * np.pi * 1.7 * time)
        student[0, :, foot] = np.sin(2 * np.pi * 1.7 * (time - shift))
    seconds, strides = metrics.phase_lag(student, teacher, DT, 1.7)
    assert seconds == pytest.approx(abs(shift), abs=0.004)
    assert strides == pytest.approx(seconds * 1.7)


def test_describe_names_every_column_with_its_unit() -> None:
    features, contact = run(frequency=1.7, episodes=8)
    ones = np.ones(features.shape[:2])
    flags = np.repeat(contact[:, :, None], 4, axis=2)
    loads = GaitLoads(0.25 * ones, flags, flags, flags & False, flags)
    powers = dict(zip(POWERS, (900 * ones, 600 * ones, 200 * ones, 100 * ones), strict=True))
    known = {"velocity": 4.1 * ones, "contact": contact, "trunk_lean": 0.1 * ones, "loads": loads}
    gait = Gait(features, ones > 0, np.zeros(8, bool), DT, **known, **powers)
    row = metrics.describe(gait, target_speed=4.0, mass=71.8)
    assert row["falls"] == 0
    assert row["mean_speed_m_per_s"] == pytest.approx(4.1)
    assert row["speed_error_percent"] == pytest.approx(2.5)
    assert row["stride_frequency_hz"] == pytest.approx(1.7, rel=0.01)
    assert row["touchdown_phase_strides"] == pytest.approx(0.5, abs=0.02)
    assert row["trunk_lean_deg"] == pytest.approx(np.degrees(0.1))
    assert row["cost_of_transport"] == pytest.approx(900 / (71.8 * 9.81 * 4.1))
    assert row["cost_without_retraction"] == pytest.approx(700 / (71.8 * 9.81 * 4.1))
    assert row["positive_power_w_per_kg"] == pytest.approx(600 / 71.8)
    assert row["positive_power_without_retraction_w_per_kg"] == pytest.approx(500 / 71.8)
    assert (row["stop_torque_share"], row["ankle_stop_percent"], row["sliding_percent"]) == (0.25, 100.0, 0.0)
    assert row["contact_bouts"] == 1.0
    assert all(np.isfinite(value) for value in row.values())
    bare = metrics.describe(Gait(features, ones > 0, np.zeros(8, bool), DT), target_speed=4.0)
    assert np.isnan(bare["mean_speed_m_per_s"])
    assert np.isnan([bare[name] for name in (*metrics.ENERGY_MEASURES, *LOAD_MEASURES)]).all()
    assert np.isfinite(bare["stride_frequency_hz"])
    assert bare.keys() == row.keys()


def test_energy_counts_valid_steps_and_what_was_recorded() -> None:
    """A walker of 50 kg at 2 m/s in two valid steps of three: 300 W, of which 200 W positive."""
    features, valid = np.zeros((1, 3, 5)), np.array([[True, True, False]])
    power, positive, velocity = np.array([[200.0, 400, 9e9], [300, 100, 9e9], [2, 2, 0]])[:, None]
    gait = Gait(features, valid, np.zeros(1, bool), DT, velocity, power=power, positive_power=positive)
    cost, own_cost, per_kg, own_per_kg = metrics.describe_energy(gait, valid, 50.0).values()
    assert (cost, per_kg) == pytest.approx((300 / (50 * 9.81 * 2), 4.0))
    assert np.isnan([own_cost, own_per_kg]).all()
    assert np.isnan(list(metrics.describe_energy(gait, valid, None).values())).all()
    still = metrics.describe_energy(replace(gait, velocity=None), valid, 50.0)
    assert np.isnan(still["cost_of_transport"])
    assert still["positive_power_w_per_kg"] == pytest.approx(4.0)


def test_the_start_from_a_reset_does_not_count_as_gait() -> None:
    features, _ = run(frequency=1.5, episodes=4)
    settled = features.copy()
    features[:, :60, 1:] += np.linspace(3.0, 0.0, 60)[:, None]  # 2 s in which both feet drift together
    valid = np.ones(features.shape[:2], bool)
    velocity = np.where(np.arange(300) < 60, 1.0, 4.0) * np.ones((4, 1))
    row = metrics.describe(Gait(features, valid, np.zeros(4, bool), DT, velocity), target_speed=4.0)
    assert row["left_right_correlation"] == pytest.approx(metrics.left_right_correlation(settled[:, 60:]))
    assert metrics.left_right_correlation(features) > -0.5
    assert row["mean_speed_m_per_s"] == pytest.approx(3.4)
    assert row["steady_speed_m_per_s"] == pytest.approx(4.0)


def test_episodes_that_fall_early_are_described_whole() -> None:
    valid = np.arange(300) < np.array([[20], [40]])
    np.testing.assert_array_equal(metrics.steady_steps(valid, DT), valid)
    valid[0] = True
    assert metrics.steady_steps(valid, DT).sum(axis=1).tolist() == [180, 0]


def test_every_number_has_a_row() -> None:
    """What `describe` and the evaluation say of a walker, what follows from it, and the bands."""
    derived = {"falls_percent", "stride_length_m", "phase_lag_s", "phase_lag_strides"}
    derived |= {"error_over_variance", "largest_error_over_variance", *JUMP_MEASURES}
    features, _ = run(frequency=1.7)
    gait = Gait(features, np.ones(features.shape[:2], bool), np.zeros(len(features), bool), DT)
    assert set(metrics.describe(gait, target_speed=4.0)) | derived == MEASURES.keys()
    of_libraries = {"peak_force_body_weights", "force_valley", "net_extension_m"}
    assert {band.measure for band in human_bands.table()} <= MEASURES.keys() | of_libraries
    assert {measure.better for measure in MEASURES.values()} == {"higher", "lower", None}
