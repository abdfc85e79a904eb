"""Null models and their scores, with numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from romgrl.gait.alignment import mse_table
from romgrl.gait.distances import measure_distances
from romgrl.gait.features import ALIGNMENTS, ALL, CHANNELS, Floats, Gait
from romgrl.gait.null_models import (
    AVERAGE,
    MEAN_ERROR,
    OVER_VARIANCE,
    REDUCTIONS,
    SCORED,
    NullModel,
    first_harmonic,
    null_models,
    sinusoids,
    stretched,
)
from romgrl.gait.null_table import null_table
from romgrl.gait.periodicity import frequency
from tests.helpers.synthetic_gait import DT, run

CADENCE, STRIDE = 1.5, 20  # strides/s, and steps of each
WINDOW = 2 * STRIDE
MEANS = np.array([0.9, 0.02, -0.8, 0.01, -0.81])


def episodes(count: int = 4, steps: int = 6 * STRIDE) -> list[Floats]:
    """One periodic gait, begun at other steps of the stride."""
    features, _ = run(episodes=1, steps=steps + STRIDE, frequency=CADENCE)
    return [features[0, shift : shift + steps] for shift in range(0, STRIDE, STRIDE // count)]


def waves(count: int = 4, steps: int = 6 * STRIDE) -> list[Floats]:
    """Cosines at the cadence, of the pelvis at twice that, the feet in antiphase."""
    angle = 2 * np.pi * np.arange(steps + STRIDE) / STRIDE
    x, z = angle + 0.2 * np.pi, angle + 2.0  # x a whole number of steps from its peak, where a sinusoid begins
    left, right = ((0.3 * np.cos(x + turn), 0.1 * np.cos(z + turn)) for turn in (0.0, np.pi))
    features = np.column_stack((0.04 * np.cos(2 * angle - 1.0), *left, *right)) + MEANS
    return [features[shift : shift + steps] for shift in range(0, STRIDE, STRIDE // count)]


def scores(reference: list[Floats], baseline: list[Floats] | None = None, target: float = CADENCE) -> pd.Series:
    """The values of null_models.csv by walker, measure and channel."""
    return table_of(reference, baseline, target).set_index(["walker", "measure", "channel"])["value"].sort_index()


def table_of(reference: list[Floats], baseline: list[Floats] | None = None, target: float = CADENCE) -> pd.DataFrame:
    """null_models.csv of a student that is the teacher and a baseline that crouches, where there is no other one."""
    models, absent = null_models(reference, DT, CADENCE, target, WINDOW)
    assert not absent
    crouched = (
        [episode + np.array([-0.2, 0.1, 0.1, 0.1, 0.1]) for episode in reference] if baseline is None else baseline
    )
    return beside(models, reference, student=reference, baseline=crouched)


def beside(
    models: dict[str, NullModel], reference: list[Floats], *, student: list[Floats], baseline: list[Floats]
) -> pd.DataFrame:
    """null_models.csv beside what the evaluation has of the others."""
    compared = {"reference": gait(reference), "student": gait(student), "baseline": gait(baseline)}
    errors, distances = mse_table(**compared, window=WINDOW), measure_distances(**compared, window=WINDOW, seed=0)
    return null_table(models, reference, errors=errors, distances=distances, window=WINDOW, seed=0)


def gait(upright: list[Floats]) -> Gait:
    """Of episodes without a fall, or where there are none of one that fell."""
    features = np.stack(upright or [np.zeros((WINDOW, 5))])
    valid = np.full(features.shape[:2], bool(upright))
    return Gait(features, valid, ~valid[:, -1], DT)


def test_a_statue_scores_one_and_the_teacher_zero() -> None:
    found = scores(episodes())
    for channel in (*CHANNELS, AVERAGE):
        assert found["statue", OVER_VARIANCE, channel] == pytest.approx(1.0, rel=1e-9)
        assert found["teacher", OVER_VARIANCE, channel] == pytest.approx(0.0, abs=1e-20)
        assert found["student", OVER_VARIANCE, channel] == pytest.approx(0.0, abs=1e-20)


def test_the_floor_of_identical_episodes_is_zero() -> None:
    found = scores([episodes()[0]] * 4)
    assert found["teacher", OVER_VARIANCE].max() == pytest.approx(0.0, abs=1e-20)
    for distance in ("mmd", "wasserstein", "dtw"):
        assert found["teacher", distance, ALL] == pytest.approx(0.0, abs=1e-9)
        assert found["statue", distance, ALL] > 0.01


def test_a_reference_of_cosines_is_its_own_sinusoid() -> None:
    reference = waves()
    found = scores(reference)
    assert found["sinusoid", OVER_VARIANCE].max() == pytest.approx(0.0, abs=1e-3)
    assert found["sinusoid", "dtw", ALL] == pytest.approx(0.0, abs=0.02)
    assert scores(episodes())["sinusoid", OVER_VARIANCE, "left_foot_z"] > 0.1  # which is half a cosine
    wave = first_harmonic(reference, DT)
    np.testing.assert_allclose(abs(wave.amplitude), [0.04, 0.3, 0.1, 0.3, 0.1], rtol=1e-3)
    np.testing.assert_allclose(wave.mean, MEANS, atol=1e-3)


@pytest.mark.parametrize("later", [0.0, 0.3])
def test_hops_and_skips_of_cosines_are_their_own_sinusoid(later: float) -> None:
    """The body rises once in a stride, and the right foot follows the left one by less than half of it."""
    time = DT * np.arange(10 * STRIDE)
    phase = 2 * np.pi * (CADENCE * time[:, None] - np.array([0.2, 0.0, 0.1, later, 0.1 + later]))
    reference = [
        np.roll(MEANS + np.array([0.1, 0.3, 0.1, 0.3, 0.1]) * np.cos(phase), start, axis=0) for start in (0, 7)
    ]
    assert scores(reference)["sinusoid", OVER_VARIANCE].max() == pytest.approx(0.0, abs=1e-3)


def test_the_feet_of_a_sinusoid_are_in_antiphase() -> None:
    """Also where those of the reference are not; the episodes begin evenly spread over the stride."""
    limp = [np.column_stack((each[:, :3], np.roll(each[:, 3:], 3, axis=0))) for each in episodes()]
    found = sinusoids(limp, DT, CADENCE, 5 * STRIDE)
    for episode in found:
        left, right = episode[:80, 1:3], episode[10:90, 3:]
        np.testing.assert_allclose(left - left.mean(axis=0), right - right.mean(axis=0), atol=1e-3)
    assert [int(each[:STRIDE, 1].argmax()) for each in found] == [0, 15, 10, 5]


def test_stretched_by_one_is_the_teacher() -> None:
    reference = [
        each + 0.01 * np.random.default_rng(i).standard_normal(each.shape) for i, each in enumerate(episodes())
    ]
    np.testing.assert_array_equal(stretched(reference[0], 1.0), reference[0])
    found = scores(reference)
    pd.testing.assert_series_equal(found["stretched"], found["teacher"], check_names=False)
    assert found["teacher", OVER_VARIANCE, AVERAGE] > 0.001  # no episode is laid over its own


def test_stretched_has_the_students_cadence_and_the_teachers_path() -> None:
    whole = episodes(steps=300)[0]
    slow = stretched(whole, 0.8)
    assert len(slow) == 374  # 299 steps of the teacher, at 0.8 of a step each
    assert frequency(slow[:, [1]], DT) == pytest.approx(0.8 * CADENCE, rel=1e-3)
    np.testing.assert_allclose(slow[::5], whole[::4])
    assert scores(episodes(), target=0.8 * CADENCE)["stretched", OVER_VARIANCE, AVERAGE] > 0.3


def test_reductions_are_against_the_baseline_as_mean_and_of_the_mean() -> None:
    reference = episodes()
    offset = np.array([0.1, 0.2, 0.05, 0.2, 0.05])
    found = scores(reference, baseline=[reference[0] + 2 * offset])
    nearest = found.xs(REDUCTIONS["aligned"], level="measure")
    assert (nearest["baseline"] == 0.0).all()
    assert (nearest["teacher"] == 100.0).all()
    for alignment in ALIGNMENTS:
        channels = found["statue", REDUCTIONS[alignment]]
        assert channels[AVERAGE] == pytest.approx(channels[[*CHANNELS]].mean())
        assert channels[MEAN_ERROR] != pytest.approx(channels[AVERAGE])


def test_a_raw_reduction_by_hand() -> None:
    """Laid over the first window, twice the offset is four times the error: a student half as far off has 75 % less."""
    reference = episodes(steps=5 * STRIDE)
    offset = np.array([0.1, 0.2, 0.05, 0.2, 0.01])
    statue = NullModel([reference[0] + offset * [0, 2, 2, 2, 2]])  # nothing off in the pelvis
    student, baseline = ([reference[0] + each] for each in (offset, 2 * offset))
    table = beside({"statue": statue}, reference, student=student, baseline=baseline)
    raw = table[table.measure == REDUCTIONS["raw"]].set_index(["walker", "channel"])["value"]
    np.testing.assert_allclose(raw["student"].to_numpy(float), 75.0)
    assert raw["statue", AVERAGE] == pytest.approx(20.0)
    assert raw["statue", MEAN_ERROR] == pytest.approx(100 * 0.1**2 / (offset**2).sum())


def test_rows_are_in_order_and_complete() -> None:
    table = table_of(episodes())
    assert list(dict.fromkeys(table.walker)) == [name for name in SCORED if name != "other_teacher"]
    assert set(table.walker.value_counts()) == {6 + 3 * 7 + 1 + 6 + 6}
    assert table.value.notna().all()


def test_without_strides_there_is_no_sinusoid_and_none_is_stretched() -> None:
    still = [np.ones((120, 5))] * 3
    models, absent = null_models(still, DT, float("nan"), CADENCE, WINDOW)
    assert set(models) == {"statue"}
    assert absent == dict.fromkeys(("sinusoid", "stretched"), "the reference has no strides")
    models, absent = null_models(episodes(), DT, CADENCE, float("nan"), WINDOW)
    assert absent == {"stretched": "the student has no strides"}
    assert set(models) == {"statue", "sinusoid"}


def test_a_walker_that_falls_has_no_scores_and_a_baseline_that_falls_leaves_no_reductions() -> None:
    found = scores(episodes(), baseline=[])
    assert found["baseline"].isna().all()
    for measure in REDUCTIONS.values():
        assert found["statue", measure].isna().all()
    assert found["statue", OVER_VARIANCE, AVERAGE] == pytest.approx(1.0)
