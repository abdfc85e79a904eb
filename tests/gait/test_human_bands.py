"""The human bands: well formed, in agreement with each other and with mechanics, and told in plain words."""

from __future__ import annotations

import math

import pytest

from romgrl.gait import human_bands
from romgrl.gait.metrics import GRAVITY

MEASURES = {"stride_frequency_hz", "stride_length_m", "duty_factor", "pelvis_excursion_m"}
FORCES = {"peak_force_body_weights", "force_valley", "net_extension_m"}
ROW = {
    "steady_speed_m_per_s": 4.0,
    "stride_frequency_hz": 1.5,
    "duty_factor": 0.30,
    "pelvis_excursion_m": 0.086,
}


@pytest.mark.parametrize("speed", [1.0, 1.4, 2.5, 4.0])
def test_every_speed_has_every_measure_with_a_source(speed: float) -> None:
    bands = human_bands.bands(speed)
    assert set(bands) - FORCES == MEASURES | (set() if speed == 2.5 else set(human_bands.ENERGY))
    assert all(0 < band.low < band.high and band.source for band in bands.values())


@pytest.mark.parametrize("speed", [1.0, 1.2, 1.4, 2.5, 3.0, 4.0])
def test_stride_length_is_speed_over_stride_frequency(speed: float) -> None:
    bands = human_bands.bands(speed)
    rate, length = bands["stride_frequency_hz"], bands["stride_length_m"]
    assert length.low == pytest.approx(speed / rate.high, rel=0.03)
    assert length.high == pytest.approx(speed / rate.low, rel=0.03)


@pytest.mark.parametrize("speed", [2.5, 4.0])
def test_excursion_of_a_run_agrees_with_mechanics(speed: float) -> None:
    """Sine-wave method (Morin et al. 2005): F_max = m g pi/2 (t_f/t_c + 1), stance F_max t_c^2/(m pi^2) - g t_c^2/8."""
    bands = human_bands.bands(speed)
    rate = sum((bands["stride_frequency_hz"].low, bands["stride_frequency_hz"].high)) / 2
    duty = sum((bands["duty_factor"].low, bands["duty_factor"].high)) / 2
    contact = duty / rate
    flight = 0.5 / rate - contact
    force = GRAVITY * math.pi / 2 * (flight / contact + 1)
    stance = force * contact**2 / math.pi**2 - GRAVITY * contact**2 / 8
    assert bands["pelvis_excursion_m"].holds(stance + GRAVITY * flight**2 / 8)


def test_a_walk_has_double_support_and_a_run_has_flight() -> None:
    for band in human_bands.table():
        if band.measure == "duty_factor":
            assert (band.low > 0.5) if band.gait == "walk" else (band.high < 0.5)


@pytest.mark.parametrize(("speed", "known"), [(1.0, {0}), (1.4, {0, 1}), (2.5, {0, 2}), (3.61, {0, 2}), (4.0, set())])
def test_forces_have_bands_where_they_were_measured(speed: float, known: set[int]) -> None:
    names = ("peak_force_body_weights", "force_valley", "net_extension_m")
    assert FORCES & set(human_bands.bands(speed)) == {names[place] for place in known}


def test_people_push_harder_the_faster_they_run_and_walk_with_less() -> None:
    slow, fast, walk = (human_bands.bands(speed)["peak_force_body_weights"] for speed in (2.5, 3.61, 1.4))
    assert walk.high < slow.low < fast.low
    assert (fast.low + fast.high) / 2 == pytest.approx(2.62, rel=0.01)


def test_a_hop_is_held_to_bands_of_its_own() -> None:
    hops = human_bands.COMPARED_WITH["hop"]
    assert set(human_bands.bands(0.0, hops)) == {"stride_frequency_hz"}
    assert human_bands.outside(ROW, 1.0, hops).keys() == {"stride_frequency_hz"}
    assert human_bands.human_verdict(ROW | {"stride_frequency_hz": 2.2}, 0.0, hops).startswith("in all human bands")
    assert human_bands.human_verdict(ROW, 1.0, ()) == "no human bands of such a gait"


def test_a_row_is_held_to_the_measures_that_it_has() -> None:
    assert set(human_bands.bands_for(ROW, 2.5)) == MEASURES - {"stride_length_m"}
    force = ROW | {"peak_force_body_weights": 3.0}
    assert "peak_force_body_weights" in human_bands.outside(force, 2.5)


def test_between_two_speeds_a_band_is_interpolated() -> None:
    slow, fast, middle = (human_bands.bands(speed)["duty_factor"] for speed in (2.5, 4.0, 3.25))
    assert middle.low == pytest.approx((slow.low + fast.low) / 2)
    assert middle.high == pytest.approx((slow.high + fast.high) / 2)


@pytest.mark.parametrize("speed", [0.5, 1.9, 5.0])
def test_there_is_no_band_where_nothing_is_known(speed: float) -> None:
    assert human_bands.bands(speed) == {}
    assert human_bands.human_verdict(ROW, speed) == f"no human bands at {speed:g} m/s"


def test_a_human_run_is_in_all_bands() -> None:
    assert human_bands.outside(ROW, 4.0) == {}
    assert human_bands.human_verdict(ROW, 4.0).startswith("in all human bands")


def test_a_number_outside_is_named_with_its_band() -> None:
    quick = ROW | {"stride_frequency_hz": 2.16, "duty_factor": math.nan}
    assert set(human_bands.outside(quick, 4.0)) == {"stride_frequency_hz", "stride_length_m", "duty_factor"}
    assert "stride_frequency_hz 2.16 (1.35 to 1.6)" in human_bands.human_verdict(quick, 4.0)


def test_a_measure_known_at_one_speed_holds_there_alone() -> None:
    assert (human_bands.bands(4.0)[human_bands.POWER].low, human_bands.bands(4.0)[human_bands.POWER].high) == (6, 9)
    assert human_bands.POWER not in human_bands.bands(3.9)


@pytest.mark.parametrize("speed", [1.0, 1.4])
def test_the_most_power_of_a_walk_is_what_moves_body_and_limbs(speed: float) -> None:
    """Heglund et al. 1982, equation of the abstract: 0.478 v^1.53 + 0.685 v + 0.072 W/kg."""
    moved = 0.478 * speed**1.53 + 0.685 * speed + 0.072
    assert human_bands.bands(speed)[human_bands.POWER].high == pytest.approx(moved, rel=0.01)


@pytest.mark.parametrize("speed", [1.0, 1.4, 4.0])
def test_the_cost_of_a_gait_is_twice_its_positive_power_per_weight_and_speed(speed: float) -> None:
    power, cost = (human_bands.bands(speed)[name] for name in human_bands.ENERGY)
    assert [cost.low, cost.high] == pytest.approx(
        [2 * limit / (GRAVITY * speed) for limit in (power.low, power.high)], rel=0.02
    )


def test_energy_of_a_walker_on_springs_is_held_to_no_band() -> None:
    """Joints of people have tendons, which give back what they took; the springs of the model are in no number."""
    energy = {human_bands.POWER: 3.0, "cost_of_transport": 0.2}
    assert set(human_bands.outside(ROW | energy, 4.0)) == set(human_bands.ENERGY)
    springs = ROW | energy | {human_bands.ON_SPRINGS: 1.0}
    assert human_bands.outside(springs, 4.0) == {}
    assert "power" not in human_bands.human_verdict(springs, 4.0)
    assert human_bands.outside(ROW | {"cost_of_transport": 0.4}, 4.0) == {}


def test_power_is_asked_of_walkers_with_joints_only() -> None:
    assert set(human_bands.outside(ROW | {human_bands.POWER: 20.0}, 4.0)) == {human_bands.POWER}
    assert human_bands.outside(ROW | {human_bands.POWER: math.nan}, 4.0) == {}
    assert human_bands.POWER not in human_bands.human_verdict(ROW, 4.0)
    assert human_bands.POWER in human_bands.human_verdict(ROW | {human_bands.POWER: 8.0}, 4.0)


def test_nothing_that_strides_has_no_stride_length() -> None:
    assert math.isnan(human_bands.stride_length(ROW | {"stride_frequency_hz": 0.0}))
    assert math.isnan(human_bands.stride_length(ROW | {"stride_frequency_hz": math.nan}))
