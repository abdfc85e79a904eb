"""What joints and feet bear, from flags made by hand: S = 4 substeps of each control step of 0.02 s."""

import numpy as np
import pytest

from romgrl.gait.features import LEFT_Z, RIGHT_Z, Bools, GaitLoads
from romgrl.gait.load_metrics import (
    LONGEST_GAP,
    contact_bouts,
    describe_loads,
    force_valley,
    landed,
    net_extension,
    step_time_asymmetry,
    without_gaps,
)

DT, SUBSTEPS = 0.02, 4
GAP = round(LONGEST_GAP / DT * SUBSTEPS)  # 20 substeps


def flags(left: Bools, right: Bools) -> Bools:
    """(1, T, S, 2) of two feet (T S,)."""
    return np.stack((left, right), axis=-1).reshape(1, -1, SUBSTEPS, 2)


def stances(*bounds: tuple[int, int], length: int = 400) -> Bools:
    """Contact (N,) from and to these substeps."""
    contact = np.zeros(length, bool)
    for start, stop in bounds:
        contact[start:stop] = True
    return contact


def all_of(touching: Bools) -> Bools:
    return np.ones(touching.shape[:2], bool)


def test_landings_are_where_contact_begins() -> None:
    assert landed(np.array([1, 1, 0, 1, 0, 0, 1, 1], bool)).tolist() == [3, 6]
    assert landed(np.zeros(5, bool)).tolist() == []


def test_gaps_shorter_than_the_longest_are_closed() -> None:
    contact = stances((10, 20), (22, 30), (40, 50), (69, 80), length=100)
    closed = without_gaps(contact, 11)
    assert closed.tolist() == stances((10, 50), (69, 80), length=100).tolist()
    assert without_gaps(contact, 10).tolist() == stances((10, 30), (40, 50), (69, 80), length=100).tolist()
    assert without_gaps(contact, 0).tolist() == contact.tolist()
    assert contact[20] == 0  # the argument stays
    for edge in (stances((0, 5), length=20), stances((15, 20), length=20), np.zeros(20, bool), np.ones(20, bool)):
        assert without_gaps(edge, 50).tolist() == edge.tolist()


def test_a_foot_that_stays_has_one_bout_per_stance() -> None:
    touching = flags(stances((20, 60), (140, 180), (260, 300)), stances((80, 120), (200, 240)))
    assert contact_bouts(touching, all_of(touching), DT) == 1.0


def test_a_foot_that_chatters_has_more() -> None:
    """Two of the left foot's three stances bounce once, and the right foot's one twice: 4 stances, 8 landings."""
    left = stances((20, 40), (43, 60), (140, 160), (160 + GAP - 1, 200), (260, 300))
    right = stances((80, 90), (95, 100), (105, 120))
    touching = flags(left, right)
    assert contact_bouts(touching, all_of(touching), DT) == 8 / 4
    longer = flags(stances((20, 40), (40 + GAP, 80)), stances((120, 140)))
    assert contact_bouts(longer, all_of(longer), DT) == 1.0  # a gap of the longest is a flight


def test_no_landing_no_bouts() -> None:
    touching = flags(np.ones(40, bool), np.zeros(40, bool))
    assert np.isnan(contact_bouts(touching, all_of(touching), DT))
    assert np.isnan(step_time_asymmetry(touching, all_of(touching), DT))


def test_bouts_of_episodes_add_up_and_only_valid_steps_count() -> None:
    clean = flags(stances((20, 60), length=100), stances((70, 90), length=100))
    chatter = flags(stances((20, 40), (42, 60), length=100), stances((70, 90), length=100))
    touching = np.concatenate((clean, chatter))
    valid = all_of(touching)
    assert contact_bouts(touching, valid, DT) == pytest.approx(5 / 4)
    valid[1, 10:] = False  # before the chatter's second landing at substep 42
    assert contact_bouts(touching, valid, DT) == 1.0


def test_steps_of_equal_times_have_no_asymmetry() -> None:
    left, right = (stances(*((start, start + 30) for start in range(first, 380, 80))) for first in (10, 50))
    touching = flags(left, right)
    assert step_time_asymmetry(touching, all_of(touching), DT) == 0.0


def test_asymmetry_of_step_times() -> None:
    """From left to right 30 substeps, from right to left 50: |30 - 50| / 40; chatter changes nothing."""
    left, right = (stances(*((start, start + 25) for start in range(first, 380, 80))) for first in (10, 40))
    touching = flags(left, right)
    assert step_time_asymmetry(touching, all_of(touching), DT) == pytest.approx(0.5)
    mirrored = touching[..., ::-1]
    assert step_time_asymmetry(mirrored, all_of(touching), DT) == pytest.approx(0.5)
    left[[20, 22, 100]] = False
    touching = flags(left, right)
    assert step_time_asymmetry(touching, all_of(touching), DT) == pytest.approx(0.5)


def test_times_do_not_reach_from_one_episode_to_the_next() -> None:
    left, right = stances((10, 30), length=80), stances((50, 70), length=80)
    touching = np.concatenate((flags(left, right), flags(right, left)))
    assert step_time_asymmetry(touching, all_of(touching), DT) == 0.0  # 40 each; 10 between the episodes


def test_the_valley_between_two_humps() -> None:
    force, valid = np.zeros((1, 40, 2)), np.ones((1, 40), bool)
    force[0, 5:16, 0] = [1, 4, 8, 10, 7, 6, 7, 9, 8, 4, 1]
    assert force_valley(force, valid) == pytest.approx(6 / 9, abs=0.02)
    force[0, 5:16, 0] = [1, 4, 8, 10, 11, 12, 11, 9, 8, 4, 1]
    assert force_valley(force, valid) == pytest.approx(1.0, abs=0.03)
    force[:] = 1.0  # it never lands
    assert np.isnan(force_valley(force, valid))


def test_how_much_longer_a_leg_leaves_the_ground() -> None:
    """Of whole stances alone: a leg of 0.80 m touches down; it leaves with 0.84 m, in the step before or after."""
    features, contact = np.zeros((1, 10, 5)), np.zeros((1, 10, 2), bool)
    contact[0, 2:5, 0] = True
    contact[0, 8:, 0] = True
    features[..., LEFT_Z] = -np.array([0.8, 0.8, 0.75, 0.7, 0.82, 0.84, 0.7, 0.7, 0.7, 0.9])
    features[..., RIGHT_Z] = -0.9
    valid = np.ones((1, 10), bool)
    assert net_extension(features, contact, valid) == pytest.approx(0.04)
    features[0, 4, LEFT_Z], features[0, 5, LEFT_Z] = -0.85, -0.6
    assert net_extension(features, contact, valid) == pytest.approx(0.05)
    assert np.isnan(net_extension(features, contact & False, valid))


def test_rows_by_hand() -> None:
    """What is not valid counts nowhere."""
    touching = flags(stances((20, 60), length=80), stances((0, 40), length=80))
    valid = all_of(touching)
    valid[0, 15:] = False
    loads = GaitLoads(
        stop_share=np.where(np.arange(20) == 3, 0.4, 0.1)[None] + 9.0 * ~valid,
        touching=touching,
        loaded=touching & (np.arange(80).reshape(1, 20, 4, 1) >= 20),
        sliding=touching & (np.arange(80).reshape(1, 20, 4, 1) >= 30),
        ankle_stop=flags(stances((20, 30), (70, 80), length=80), stances((60, 80), length=80)),
    )
    row = describe_loads(loads, valid, DT)
    assert row["stop_torque_share"] == pytest.approx(0.4)
    assert row["ankle_stop_percent"] == pytest.approx(100 * 10 / 80)  # 40 substeps of each foot on the ground
    assert row["sliding_percent"] == pytest.approx(100 * (30 + 10) / (40 + 20))
    assert row["contact_bouts"] == 1.0
    assert np.isnan(row["step_time_asymmetry_percent"])
    nothing = describe_loads(loads, valid & False, DT)
    assert np.isnan(list(nothing.values())).all()
