import numpy as np
import pytest

from romgrl.gait import alignment
from romgrl.gait.features import CHANNELS, LOADS, POWERS, Floats, Gait, gait_from_reference, gait_from_rollouts
from tests.helpers.synthetic_gait import DT, run


def gait(features: Floats, fallen: int = 0) -> Gait:
    """All upright but the first `fallen` episodes, which fall at step 50."""
    valid = np.ones(features.shape[:2], bool)
    valid[:fallen, 50:] = False
    return Gait(features, valid, np.arange(len(features)) < fallen, DT)


def floor(reference: list[Floats], over: str = "aligned") -> Floats:
    return alignment.mean_error(reference, reference, 100, over, own=True)


def brute_force(window: Floats, reference: list[Floats]) -> tuple[float, Floats]:
    """Least variance-normalised error and the channel errors at it, by three plain loops."""
    variance = np.concatenate(reference).var(axis=0)
    best, channels = np.inf, np.zeros(5)
    for episode in reference:
        for start in range(len(episode) - len(window) + 1):
            errors = np.array(
                [np.mean((window[:, c] - episode[start : start + len(window), c]) ** 2) for c in range(5)]
            )
            if (score := float((errors / variance).sum())) < best:
                best, channels = score, errors
    return best, channels


def test_equals_brute_force() -> None:
    rng = np.random.default_rng(3)
    reference = [rng.standard_normal((n, 5)) * [0.1, 1, 0.2, 1, 0.2] for n in (61, 40, 55)]
    windows = rng.standard_normal((4, 30, 5))
    result = alignment.align(windows, reference)
    for window, mse in zip(windows, result.mse, strict=True):
        np.testing.assert_allclose(mse, brute_force(window, reference)[1], rtol=1e-12)


def test_recovers_a_known_shift() -> None:
    features, _ = run(episodes=3, steps=400, noise=0.01)
    query = features[1, 137:237] + 0.02
    result = alignment.align(query[None], list(features))
    np.testing.assert_array_equal(result.matched[0], features[1, 137:237])
    np.testing.assert_array_equal(result.starts, [[1, 137]])
    np.testing.assert_allclose(result.mse[0], 0.02**2, rtol=1e-9)


def test_no_window_crosses_an_episode() -> None:
    # the query straddles the bound of the two episodes: a crossing window would fit exactly
    ramp = np.repeat(np.arange(200.0)[:, None], 5, axis=1)
    result = alignment.align(ramp[None, 80:120], [ramp[:100], ramp[100:]])
    np.testing.assert_allclose(result.mse[0], 20.0**2)
    assert len(alignment.all_windows([ramp[:100], ramp[100:]], 40)) == 2 * 61
    with pytest.raises(ValueError, match="no episode of the reference has 101 steps, the longest has 100"):
        alignment.all_windows([ramp[:100], ramp[100:]], 101)


def test_one_shift_serves_all_channels() -> None:
    features, _ = run(episodes=2, steps=400, frequency=1.5)
    query = features[0, :100].copy()
    query[:, 3] = query[:, 1]  # a hop cannot be aligned away: right foot x is off by 2 A cos
    mse = alignment.align(query[None], list(features)).mse[0]
    assert mse[1] + mse[3] > 0.1


def test_raw_uses_the_first_window() -> None:
    features, _ = run(episodes=2, steps=300)
    windows = alignment.last_windows(list(features), 100)
    mse = alignment.align(windows, list(features), raw=True).mse
    np.testing.assert_allclose(mse, ((windows - features[0, :100]) ** 2).mean(axis=1))


def test_floor_of_a_periodic_teacher_is_zero_and_of_a_noisy_one_twice_its_variance() -> None:
    features, _ = run(episodes=3, steps=400, frequency=1.5)  # 20 steps per stride, start phases on the grid:
    exact = [features[0, shift : shift + 350] for shift in (0, 7, 13)]
    np.testing.assert_allclose(floor(exact), 0.0, atol=1e-24)
    np.testing.assert_allclose(floor(exact[:1]), 0.0, atol=1e-24)
    np.testing.assert_allclose(floor([features[0]] * 3, "one_episode"), 0.0, atol=1e-24)
    opposed = floor([features[0, :300], features[0, 10:310]], "raw")  # half a stride apart: twice the swing off
    np.testing.assert_allclose(opposed[1], 4 * features[0, :20, 1].var(), rtol=1e-9)
    rng = np.random.default_rng(0)
    noisy = [e + 0.01 * rng.standard_normal(e.shape) for e in exact]
    np.testing.assert_allclose(floor(noisy), 2e-4, rtol=0.25)  # the best of many: a little below
    assert np.isnan(floor([features[0, :120]])).all()
    assert np.isnan(floor(exact[:1], "one_episode")).all()


def test_table_has_the_fixed_columns_and_the_papers_average() -> None:
    reference, _ = run(episodes=4, steps=400, frequency=1.5)
    student, baseline = reference[:, 11:311].copy(), reference[:, 11:311].copy()
    for channel in range(5):
        student[..., channel] += 0.1 * (channel + 1)
        baseline[..., channel] += 0.3
    table = alignment.mse_table(reference=gait(reference), student=gait(student), baseline=gait(baseline), window=100)
    assert list(table.columns[:5]) == ["channel", "alignment", "baseline", "student", "reduction_percent"]
    assert list(table.channel) == [*CHANNELS, "average"] * 3
    assert list(table.alignment) == ["aligned"] * 6 + ["one_episode"] * 6 + ["raw"] * 6
    rows = table[table.alignment == "aligned"].set_index("channel")
    # constant offsets: the best shift may trade phase for offset, so compare against brute force
    episodes = list(reference)
    expected = np.mean([brute_force(w, episodes)[1] for w in student[:, -100:]], axis=0)
    np.testing.assert_allclose(rows.student.iloc[:5].to_numpy(float), expected, rtol=1e-9)
    channels = rows.iloc[:5]
    reductions = 100 * (1 - channels.student / channels.baseline)
    np.testing.assert_allclose(channels.reduction_percent.to_numpy(float), reductions.to_numpy(float))
    assert rows.loc["average", "reduction_percent"] == pytest.approx(reductions.mean())
    assert rows.loc["average", "student"] == pytest.approx(channels.student.mean())
    assert set(table.note) == {"ok"}


def test_the_papers_average_is_the_mean_of_the_five_reductions() -> None:
    baseline = np.array([0.01407, 0.25035, 0.01750, 0.18821, 0.02543])
    student = np.array([0.00408, 0.18992, 0.01708, 0.07136, 0.00962])
    assert (100 * (1 - student / baseline)).mean() == pytest.approx(44.4, abs=0.05)
    assert 100 * (1 - student.sum() / baseline.sum()) == pytest.approx(41.1, abs=0.05)


def test_fallen_episodes_are_left_out_and_counted() -> None:
    reference, _ = run(episodes=4, steps=400)
    walker = reference[:, :300].copy()
    walker[:2] += 9.0
    table = alignment.mse_table(
        reference=gait(reference), student=gait(walker, fallen=2), baseline=gait(walker + 1), window=100
    )
    assert table.student.iloc[0] == pytest.approx(0.0, abs=1e-20)
    assert table.student_episodes.iloc[0] == 2
    assert table.baseline_episodes.iloc[0] == 4
    assert (table.note == "ok").all()


def test_under_half_upright_is_not_comparable() -> None:
    reference, _ = run(episodes=4, steps=400)
    walker = reference[:, :300]
    table = alignment.mse_table(
        reference=gait(reference), student=gait(walker), baseline=gait(walker, fallen=3), window=100
    )
    assert table.baseline.isna().all()
    assert table.reduction_percent.isna().all()
    assert table.student.notna().all()
    assert set(table.note) == {"not comparable: baseline upright in 1 of 4 episodes"}


def test_phase_lag_of_a_slower_student() -> None:
    reference, _ = run(episodes=4, steps=400, frequency=1.5)
    same = alignment.aligned_phase_lag(gait(reference), gait(reference), 100)
    assert same == pytest.approx((0.0, 0.0), abs=1e-9)
    limp = reference.copy()
    limp[..., 3:] = np.roll(limp[..., 3:], 4, axis=1)  # the right foot lands 4 steps, a fifth of a stride, late
    seconds, strides = alignment.aligned_phase_lag(gait(limp), gait(reference), 100)
    # one common shift cannot serve both feet: together they stay 4 steps off, 2 steps each on average
    assert seconds == pytest.approx(2 * DT, abs=0.3 * DT)
    assert strides == pytest.approx(1.5 * seconds, rel=0.01)


def test_error_over_variance_of_the_teacher_is_zero_and_of_a_statue_one() -> None:
    """Also where the teacher is laid over itself shifted in time, and whatever a channel's unit is."""
    reference, _ = run(episodes=3, steps=400, frequency=1.5)  # 20 steps per stride: a shift on the grid fits exactly
    exact = np.stack([reference[0, shift : shift + 350] for shift in (0, 7, 13)])
    np.testing.assert_allclose(alignment.error_over_variance(gait(exact), gait(exact), 100), 0.0, atol=1e-20)
    shifted = gait(exact[:1, 4:304])
    np.testing.assert_allclose(alignment.error_over_variance(shifted, gait(exact), 100), 0.0, atol=1e-20)
    statue = gait(np.broadcast_to(exact.mean(axis=(0, 1)), (2, 300, 5)))
    np.testing.assert_allclose(alignment.error_over_variance(statue, gait(exact), 100), 1.0, rtol=0.02)
    scaled = [gait(each * [1, 10, 100, 0.1, 7]) for each in (statue.features, exact)]
    np.testing.assert_allclose(alignment.error_over_variance(*scaled, 100), 1.0, rtol=0.02)


def test_error_over_variance_lies_over_one_episode_at_a_time() -> None:
    """The mean over the reference's episodes, not the best of them; each with one shift of its own, within it."""
    reference, _ = run(episodes=2, steps=300, frequency=1.5)
    reference[1, :, 1] *= 2.0
    walker = gait(reference[:1, :200])
    variance = reference.reshape(-1, 5).var(axis=0)
    window = walker.features[0, -100:]
    each = [alignment.align(window[None], [episode]).mse[0] for episode in reference]
    expected = np.mean(each, axis=0) / variance
    np.testing.assert_allclose(alignment.error_over_variance(walker, gait(reference), 100), expected)
    assert each[0].max() < 1e-9
    assert expected[1] > 0.05
    ramp = np.repeat(np.arange(200.0)[:, None], 5, axis=1)  # a window across the bound would fit exactly
    query = Gait(ramp[None, 80:120], np.ones((1, 40), bool), np.zeros(1, bool), DT)
    found = alignment.error_over_variance(query, gait(np.stack((ramp[:100], ramp[100:]))), 40)
    np.testing.assert_allclose(found, 20.0**2 / ramp[:, 0].var())


def test_the_nearest_window_of_all_episodes_is_no_further_than_that_of_one() -> None:
    reference, _ = run(episodes=3, steps=300, noise=0.02)
    walker = run(episodes=2, steps=200, frequency=1.8, seed=1)[0]
    table = alignment.mse_table(
        reference=gait(reference), student=gait(walker), baseline=gait(walker + 0.1), window=100
    )
    nearest, one = (table[table.alignment == name].set_index("channel") for name in ("aligned", "one_episode"))
    over = alignment.variances(list(reference))
    for numbers in ("student", "teacher_floor"):
        weighted = [(rows.loc[[*CHANNELS], numbers] / over).mean() for rows in (nearest, one)]
        assert weighted[0] < weighted[1]
    found = alignment.error_over_variance(gait(walker), gait(reference), 100)
    np.testing.assert_allclose(one.loc[[*CHANNELS], "student"] / over, found, rtol=1e-12)


def test_an_episode_is_not_laid_over_itself() -> None:
    rng = np.random.default_rng(0)
    noise = gait(rng.standard_normal((3, 200, 5)))
    assert alignment.error_over_variance(noise, noise, 100).min() > 1.0  # two independent noises: near 2
    copy = gait(noise.features.copy())
    assert alignment.error_over_variance(copy, noise, 100).min() > 0.5  # another walker: one of the three fits
    alone = gait(noise.features[:1])
    assert np.isnan(alignment.error_over_variance(alone, alone, 100)).all()


def test_error_over_variance_needs_an_upright_episode_of_the_windows_length() -> None:
    reference, _ = run(episodes=3, steps=300)
    fallen = gait(reference, fallen=3)
    assert np.isnan(alignment.error_over_variance(fallen, gait(reference), 100)).all()
    assert np.isnan(alignment.error_over_variance(gait(reference[:, :90]), gait(reference), 100)).all()
    one = gait(reference, fallen=2)
    assert np.isfinite(alignment.error_over_variance(one, gait(reference), 100)).all()


def test_gaits_are_read_from_the_artifacts_arrays() -> None:
    features, contact = run(episodes=3, steps=120)
    upright = np.ones((3, 120), bool)
    upright[1, 40] = False
    arrays = {"student_features": features, "student_upright": upright, "student_contact": contact, "dt": np.array(DT)}
    student = gait_from_rollouts(arrays, "student")
    assert list(student.fallen) == [False, True, False]
    assert student.valid[1].sum() == 40
    assert [len(e) for e in student.upright_episodes] == [120, 120]
    assert student.loads is None
    flags = np.repeat(contact[:, :, None], 4, axis=2)
    share = np.full((3, 120), 0.5)
    loads = dict(zip(LOADS, (share, flags, flags, ~flags, flags), strict=True))
    recorded = gait_from_rollouts(arrays | {f"student_{key}": values for key, values in loads.items()}, "student").loads
    assert recorded is not None
    for key, values in loads.items():
        np.testing.assert_array_equal(getattr(recorded, key), values)
    powers = {name: np.full((3, 120), value) for value, name in enumerate(POWERS)}
    told = gait_from_rollouts(arrays | {f"student_{name}": values for name, values in powers.items()}, "student")
    assert [getattr(told, name)[2, 7] for name in POWERS] == [0, 1, 2, 3]
    assert [getattr(student, name) for name in POWERS] == [None] * 4
    flat = {
        "features": features.reshape(-1, 5)[:300],
        "episode": np.repeat([0, 1, 4], [120, 120, 60]),
        "dt": np.array(DT),
    }
    reference = gait_from_reference(flat)
    assert [len(e) for e in reference.upright_episodes] == [120, 120, 60]
    np.testing.assert_array_equal(reference.features[2, :60], features[2, :60])
    assert [getattr(reference, name) for name in POWERS] == [None] * 4
    told = gait_from_reference(flat | {name: values.reshape(-1)[:300] for name, values in powers.items()})
    assert [getattr(told, name)[2].tolist() for name in POWERS] == [[value] * 60 + [0] * 60 for value in range(4)]
