"""Distances with known answers: closed forms, scipy and plain loops as judges."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.distance import cdist
from scipy.stats import kstest

from romgrl.gait import mmd
from romgrl.gait.distances import ALL, measure_distances, wasserstein
from romgrl.gait.dtw import warped_distance
from romgrl.gait.features import CHANNELS, MIRROR, Floats, Gait
from tests.helpers.synthetic_gait import DT, run


def gait(features: Floats, fallen: int = 0) -> Gait:
    """All upright but the first `fallen` episodes, which fall at step 50."""
    valid = np.ones(features.shape[:2], bool)
    valid[:fallen, 50:] = False
    return Gait(features, valid, np.arange(len(features)) < fallen, DT)


def correlated(rng: np.random.Generator, blocks: int, length: int = 40, memory: float = 0.95) -> Floats:
    """Stationary first-order processes of variance one, (B, W, 2): neighbours hardly differ."""
    values = np.empty((blocks, length, 2))
    values[:, 0] = rng.standard_normal((blocks, 2))
    for step in range(1, length):
        fresh = rng.standard_normal((blocks, 2))
        values[:, step] = memory * values[:, step - 1] + np.sqrt(1 - memory**2) * fresh
    return values


def test_mmd_equals_plain_loops() -> None:
    rng = np.random.default_rng(0)
    blocks = rng.standard_normal((5, 6, 3))
    kernel = mmd.block_kernel(blocks, 1.3)
    gauss = [[np.exp(-(cdist(a, b) ** 2) / (2 * 1.3**2)).mean() for b in blocks] for a in blocks]
    np.testing.assert_allclose(kernel, gauss, rtol=1e-12)
    x, y = [0, 3], [1, 2, 4]
    within = [np.mean([kernel[i, j] for i in side for j in side if i != j]) for side in (x, y)]
    between = np.mean([kernel[i, j] for i in x for j in y])
    found = mmd.mmd_squared(kernel, np.array([[1.0, 0, 0, 1, 0]]))[0]
    assert found == pytest.approx(sum(within) - 2 * between, rel=1e-12)


def test_mmd_of_two_gaussians_has_its_closed_form() -> None:
    """k of width s between N(a, 1) and N(b, 1) has the mean s / sqrt(s^2 + 2) exp(-(a - b)^2 / (2 (s^2 + 2)))."""
    rng, width, shift = np.random.default_rng(1), 1.5, 0.8
    blocks = np.concatenate((rng.standard_normal((40, 50, 1)), rng.standard_normal((40, 50, 1)) + shift))
    kernel = mmd.block_kernel(blocks, width)
    found = mmd.mmd_squared(kernel, (np.arange(80) < 40)[None].astype(float))[0]
    scale = width**2 + 2
    assert found == pytest.approx(2 * width / np.sqrt(scale) * (1 - np.exp(-(shift**2) / (2 * scale))), rel=0.1)


def test_mmd_is_unbiased_and_p_uniform_for_correlated_frames_of_one_distribution() -> None:
    rng, found, p = np.random.default_rng(2), [], []
    for seed in range(200):
        value, chance = mmd.mmd_test(correlated(rng, 8), correlated(rng, 6), 2.0, seed)
        found.append(value)
        p.append(chance)
    assert abs(np.mean(found)) < 3 * np.std(found) / np.sqrt(len(found))
    assert kstest(p, "uniform").pvalue > 0.01


def test_exchanging_frames_would_find_differences_that_are_none() -> None:
    """Why blocks: every frame a block of its own gives p < 0.05 far more often than one time in twenty."""
    rng, p = np.random.default_rng(3), []
    for seed in range(40):
        first, second = correlated(rng, 4), correlated(rng, 4)
        alone = [mmd.points(side).reshape(-1, 1, 2 * mmd.SPAN)[:100] for side in (first, second)]
        kernel = mmd.block_kernel(np.concatenate(alone), 2.0)
        own = (np.arange(len(kernel)) < len(alone[0])).astype(float)
        chance = np.random.default_rng(seed).permuted(np.tile(own, (200, 1)), axis=1)
        p.append((mmd.mmd_squared(kernel, chance) >= mmd.mmd_squared(kernel, own[None])[0]).mean())
    assert np.mean(np.array(p) < 0.05) > 0.5


def test_mmd_sees_a_shift_a_scale_and_a_cadence() -> None:
    rng = np.random.default_rng(4)
    teacher = correlated(rng, 16, memory=0.8)
    width = mmd.median_distance(mmd.points(teacher))
    same = correlated(rng, 16, memory=0.8)
    for other, least in ((same + 1.0, 0.05), (2.0 * same, 0.02), (correlated(rng, 16, memory=0.0), 0.005)):
        value, p = mmd.mmd_test(other, teacher, width, 0)
        assert value > least
        assert p < 0.01
    assert np.isnan(mmd.mmd_test(teacher[:1], teacher, width, 0)).all()


def test_median_distance_of_gaussians() -> None:
    """|x - y|^2 / 2 of standard normal points in two dimensions is exponential of mean 2: median 2 ln 2, times 2."""
    points = np.random.default_rng(5).standard_normal((10, 400, 2))
    assert mmd.median_distance(points) == pytest.approx(np.sqrt(4 * np.log(2)), rel=0.03)


def test_wasserstein_of_a_shifted_sample_is_the_shift() -> None:
    frames = np.random.default_rng(6).standard_normal((500, 5))
    shift, deviation = np.array([0.1, -0.2, 0.3, 0.0, 0.5]), np.array([1.0, 2, 3, 4, 5])
    found = wasserstein(frames[::-1] + shift, frames, deviation)
    np.testing.assert_allclose([found["wasserstein", c] for c in CHANNELS], np.abs(shift), atol=1e-12)
    assert found["wasserstein", ALL] == pytest.approx(0.1 * (1 + 1 + 1 + 0 + 1) / 5)
    # two samples of different size: uniform points on [0, 1] against the point 0
    halves = wasserstein(np.tile(np.linspace(0, 1, 1001)[:, None], 5), np.zeros((3, 5)), np.ones(5))
    assert halves["wasserstein", ALL] == pytest.approx(0.5)


def slow_dtw(a: Floats, b: Floats, scale: Floats, reach: int) -> float:
    """Sakoe and Chiba's recursion for one pair, as it is written."""
    d = np.sqrt((((a[:, None] - b[None]) / scale) ** 2).mean(axis=-1))
    g = np.full(d.shape, np.inf)
    g[0, 0] = 2 * d[0, 0]
    for i in range(len(a)):
        for j in range(len(b)):
            if abs(i - j) <= reach and (i or j):
                before = [(g[i, j - 1] + d[i, j]) if j else np.inf, (g[i - 1, j] + d[i, j]) if i else np.inf]
                g[i, j] = min(*before, (g[i - 1, j - 1] + 2 * d[i, j]) if i and j else np.inf)
    return float(g[-1, -1]) / (2 * len(a))


def test_dtw_equals_the_plain_recursion_and_its_parts_add_up() -> None:
    rng = np.random.default_rng(7)
    a, b, scale = rng.standard_normal((3, 30, 5)), rng.standard_normal((3, 30, 5)), rng.uniform(0.5, 2, 5)
    together, parts = warped_distance(a, b, scale)
    np.testing.assert_allclose(together, [slow_dtw(x, y, scale, 3) for x, y in zip(a, b, strict=True)], rtol=1e-12)
    one, part = warped_distance(a[..., :1], b[..., :1], scale[:1])  # one channel: the distance is its part
    np.testing.assert_allclose(part[:, 0], scale[0] * one, rtol=1e-12)
    assert (parts > 0).all()
    np.testing.assert_allclose(warped_distance(b, a, scale)[0], together, rtol=1e-12)
    np.testing.assert_allclose(warped_distance(a + 3, b + 3, scale)[0], together, rtol=1e-9)
    np.testing.assert_allclose(warped_distance(10 * a, 10 * b, 10 * scale)[0], together, rtol=1e-12)


def test_dtw_of_a_warped_sine() -> None:
    """Zero for itself, little for time that bends by less than the band, and as much as without for an offset."""
    t = np.linspace(0, 4 * np.pi, 200)
    wave = np.repeat(np.sin(t)[None, :, None], 5, axis=2)
    bent = np.repeat(np.sin(t + 0.6 * np.sin(t / 4))[None, :, None], 5, axis=2)  # up to 10 of 200 steps late
    same, parts = warped_distance(wave, wave, np.ones(5))
    assert same[0] == 0.0
    np.testing.assert_array_equal(parts, 0.0)
    assert warped_distance(wave, bent, np.ones(5))[0][0] < 0.1 * np.abs(wave - bent).mean()
    far, _ = warped_distance(wave, wave + 10.0, np.ones(5))
    assert 9.0 < far[0] <= 10.0  # warping cannot remove an offset


def test_a_hop_is_not_warped_into_a_run() -> None:
    features, _ = run(episodes=2, steps=100, frequency=1.75)
    hop = features.copy()
    hop[..., 3:] = hop[..., 1:3]
    apart, parts = warped_distance(hop, features, features.reshape(-1, 5).std(axis=0))
    assert (apart > 0.4).all()
    assert (parts[:, [1, 3]].sum(axis=1) > 0.2).all()


def table(**changed: Gait) -> pd.DataFrame:
    walkers = {
        "reference": gait(run(episodes=8, steps=250, frequency=1.75, noise=0.005)[0]),
        "student": gait(run(episodes=8, frequency=1.8, height=0.88, noise=0.005, seed=1)[0]),
        "baseline": gait(run(episodes=8, frequency=2.4, height=0.75, amplitude=0.5, noise=0.005, seed=2)[0]),
        **changed,
    }
    return measure_distances(**walkers, window=100, seed=0)


def test_floor_below_student_below_baseline() -> None:
    rows = table()
    assert list(rows.distance.value_counts(sort=False).items()) == [("mmd", 1), ("wasserstein", 6), ("dtw", 6)]
    assert set(rows.note) == {"ok"}
    together = rows[rows.channel == ALL].set_index("distance")
    assert (together.teacher_floor < together.student).all()
    assert (together.student < together.baseline).all()
    assert together.loc["mmd", "floor_p"] > 0.05
    assert (together.loc["mmd", ["student_p", "baseline_p"]] < 0.001).all()
    height = rows[(rows.distance == "wasserstein") & (rows.channel == "pelvis_y")].iloc[0]
    assert (height.student, height.baseline) == (pytest.approx(0.02, abs=0.003), pytest.approx(0.15, abs=0.003))
    assert height.unit == "m"


def test_another_teacher_episode_cannot_be_told_from_the_teacher() -> None:
    again = gait(run(episodes=8, steps=250, frequency=1.75, noise=0.005, seed=5)[0])
    rows = table(student=again).set_index(["distance", "channel"])
    assert rows.loc[("mmd", ALL), "student_p"] > 0.05
    assert rows.loc[("dtw", ALL), "student"] == pytest.approx(rows.loc[("dtw", ALL), "teacher_floor"], rel=0.1)


def test_left_and_right_may_be_exchanged_for_all() -> None:
    def mirror(walker: Gait) -> Gait:
        return Gait(MIRROR.image(walker.features), walker.valid, walker.fallen, walker.dt)

    walkers = {
        "reference": gait(run(episodes=4, steps=250, frequency=1.75, noise=0.005)[0]),
        "student": gait(run(episodes=4, frequency=1.8, noise=0.01, seed=1)[0]),
        "baseline": gait(run(episodes=4, frequency=2.0, noise=0.02, seed=2)[0]),
    }
    here, there = table(**walkers), table(**{name: mirror(walker) for name, walker in walkers.items()})
    numbers = ["baseline", "student", "teacher_floor", "student_p"]
    all_here, all_there = (rows.loc[rows.channel == ALL, numbers].to_numpy(float) for rows in (here, there))
    np.testing.assert_allclose(all_here, all_there, rtol=1e-6, atol=1e-12)


def test_walkers_that_fall_have_a_note_and_no_numbers() -> None:
    fallen = gait(run(episodes=4)[0], fallen=4)
    rows = table(student=fallen)
    assert set(rows.note) == {"not comparable: student upright in 0 of 4 episodes"}
    assert rows[["student", "student_p"]].isna().all(axis=None)
    assert rows.baseline.notna().all()
    nobody = table(student=fallen, baseline=fallen)
    assert nobody[["student", "baseline"]].isna().all(axis=None)
    assert nobody.teacher_floor.notna().all()


def test_one_episode_on_each_side() -> None:
    single = {"steps": 250, "episodes": 1, "noise": 0.005, "frequency": 1.75}
    rows = table(reference=gait(run(**single)[0]), student=gait(run(**single, seed=3)[0])).set_index("distance")
    assert np.isnan(rows.loc["mmd", "student"])  # one episode has no spread
    assert rows.loc[["wasserstein", "dtw"], ["student", "teacher_floor"]].notna().all(axis=None)
