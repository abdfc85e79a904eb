"""The page's data: what the player draws, strides, intervals, charts and tables, with numbers worked out by hand."""

from __future__ import annotations

import base64
import json

import mujoco
import numpy as np
import pandas as pd
import pytest

from romgrl.gait import human_bands
from romgrl.gait.features import Gait
from romgrl.humanoid.model import build
from romgrl.humanoid.skeleton import SMPL
from romgrl.report.page import charts, html, intervals, scene, strides, tables
from tests.helpers.synthetic_gait import DT, run

RATE = 1.5  # strides/s: 20 steps each at 30 Hz


def gait(episodes: int = 3, steps: int = 200, noise: float = 0.0, contact: bool = True) -> Gait:
    """Episodes of a run at 3 m/s; the left foot lands every 20 steps."""
    features, _ = run(episodes=episodes, steps=steps, frequency=RATE, noise=noise)[:2]
    phase = np.arange(steps) % 20
    feet = np.stack((phase < 6, (phase + 10) % 20 < 6), axis=-1)
    size = features.shape[:2]
    return Gait(
        features,
        np.ones(size, bool),
        np.zeros(episodes, bool),
        DT,
        velocity=np.full(size, 3.0),
        contact=np.broadcast_to(feet, (*size, 2)).copy() if contact else None,
    )


def track(of: Gait) -> scene.Track:
    assert of.contact is not None
    x = 3.0 * DT * np.arange(of.features.shape[1])
    return scene.Track(of.features[0], np.full(len(x), 3.0), of.contact[0], scene.rom_points(of.features[0]), x, DT)


def test_segments_are_the_bodies_of_the_model() -> None:
    model = build()
    state = np.zeros(model.nq)
    state[0] = 7.0
    points, x = scene.humanoid_points(model, state[None])
    parts = scene.segments(model, SMPL.right_side)
    lines = points.reshape(len(parts), 2, 2)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geoms = np.flatnonzero(model.geom_bodyid > 0).tolist()
    thigh = geoms.index(int(np.flatnonzero(model.geom_bodyid == model.body("L_Hip").id)[0]))
    ends = data.body("L_Hip").xpos[[0, 2]], data.body("L_Knee").xpos[[0, 2]]
    assert x[0] - data.xpos[1, 0] == pytest.approx(7.0)
    np.testing.assert_allclose(sorted(lines[thigh][:, 1]), sorted(end[1] for end in ends), atol=0.01)
    assert parts[thigh].radius == pytest.approx(model.geom_size[geoms[thigh], 0])
    assert sum(part.far for part in parts) == sum(model.body(model.geom_bodyid[g]).name[:2] == "R_" for g in geoms)


def test_points_travel_as_millimetres() -> None:
    points = np.array([[[0.1234, -0.5], [40.0, 0.0]]])
    assert np.frombuffer(base64.b64decode(scene.encoded(points)), "<i2").tolist() == [123, -500, 32767, 0]


def test_a_bounced_landing_begins_no_stride() -> None:
    walker = gait()
    assert walker.contact is not None
    contact = walker.contact[0, :, 0]
    contact[48] = True  # lands at 40, leaves at 46, touches again
    assert strides.landings(walker.features[0], contact, DT) == list(range(20, 200, 20))
    assert strides.landings(np.zeros((200, 5)), contact, DT) == []


def test_a_guessed_contact_of_one_step_begins_a_stride() -> None:
    walker = gait(episodes=8, noise=0.01, contact=False)
    for features, feet in zip(walker.features, strides.contacts(walker), strict=True):
        lengths = np.diff(strides.landings(features, feet[:, 0], DT))
        assert lengths == pytest.approx(20, abs=6)


def test_phase_is_linear_between_landings() -> None:
    phase = strides.phases(6, [3, 7], offset=2)
    np.testing.assert_allclose(phase, [np.nan, 0.0, 0.25, 0.5, 0.75, 0.0])
    assert np.isnan(strides.phases(4, [3], 0)).all()


def test_strides_that_are_unlike_have_no_average(monkeypatch: pytest.MonkeyPatch) -> None:
    """The usual one is between them, and neither is near it."""
    monkeypatch.setattr(strides, "landings", lambda *_: [0, 10, 80])
    assert strides.stride_average(gait(episodes=1)) is None


def test_average_of_equal_strides_is_the_stride() -> None:
    walker = gait(episodes=1)
    average = strides.stride_average(walker)
    assert average is not None
    assert average.strides == 3  # landings at 120, 140, 160, 180: the first half, at most 4 s, does not count
    np.testing.assert_allclose(average.deviation, 0.0, atol=1e-6)
    np.testing.assert_allclose(average.mean[0], walker.features[0, 120], atol=1e-6)


def test_teacher_is_in_time_with_the_walker() -> None:
    teacher, walker = gait(steps=150), gait(steps=200)
    beside = track(walker)
    found = scene.teacher_track(teacher, beside, window=60)
    assert (len(found.x), found.offset, found.end) == (150, 50, 200)
    shifted = scene.teacher_track(gait(steps=260), scene.Track(**{**vars(beside), "features": walker.features[0]}), 60)
    np.testing.assert_allclose(shifted.features[-60:], walker.features[0, -60:], atol=1e-6)
    assert shifted.x[-1] == pytest.approx(3.0 * DT * 199)
    hip, left, _ = shifted.points[0]
    np.testing.assert_allclose(left - hip, shifted.features[0, 1:3])


def test_intervals_resample_whole_episodes() -> None:
    teacher = gait(steps=300)
    walkers = {"student": gait(episodes=8, noise=0.02), "baseline": gait(episodes=8, noise=0.06)}
    table = intervals.error_intervals(teacher, walkers, window=100).set_index("channel")
    pairs = {name: intervals._errors(walker, teacher, 100) for name, walker in walkers.items()}
    generator = np.random.default_rng(0)
    draws = {name: values[generator.integers(0, 8, (4000, 8))].mean(axis=1) for name, values in pairs.items()}
    low, high = np.percentile(draws["student"].mean(axis=1), [2.5, 97.5])
    assert table.loc["average", "student_low"] == pytest.approx(low, rel=0.03)
    assert table.loc["average", "student_high"] == pytest.approx(high, rel=0.03)
    reductions = 100 * (1 - draws["student"] / draws["baseline"]).mean(axis=1)
    expected = np.percentile(reductions, [2.5, 97.5])
    columns = ["reduction_percent_low", "reduction_percent_high"]
    np.testing.assert_allclose(table.loc["average", columns].to_numpy(float), expected, atol=0.4)


def test_no_interval_without_episodes() -> None:
    fallen = gait()
    lost = Gait(fallen.features, fallen.valid, np.ones(3, bool), DT)
    table = intervals.error_intervals(gait(steps=300), {"student": gait(), "baseline": lost}, window=100)
    assert table.drop(columns="channel").isna().all(axis=None)


def test_footfall_spans() -> None:
    starts, lengths = charts.contact_spans(np.array([True, True, False, True, False, False, True]))
    assert (starts.tolist(), lengths.tolist()) == ([0, 3, 6], [2, 1, 1])


def test_cursors_are_on_the_curves() -> None:
    tracks = {"student": track(gait())}
    chart = charts.portraits(tracks, DT)[0]
    assert isinstance(chart.cursor, dict)
    np.testing.assert_allclose(chart.cursor["student"]["x"], chart.figure.data[0].x, atol=1e-4)
    average = strides.stride_average(gait(episodes=1))
    assert average is not None
    cursor = charts.stride_averages({"student": average}, tracks)[1].cursor
    assert isinstance(cursor, dict)
    assert cursor["student"]["x"][:20] == [None] * 20  # before the first landing
    assert cursor["student"]["x"][30] == pytest.approx(50.0)
    assert cursor["student"]["y"][30] == pytest.approx(tracks["student"].features[30, 1], abs=2e-3)


def test_gait_rows_know_the_human_band() -> None:
    band = human_bands.bands(4.0)["duty_factor"]
    row = {"walker": "student", "steady_speed_m_per_s": 4.0, "stride_frequency_hz": 1.5, "duty_factor": band.high + 0.1}
    rows = {row.label: row for row in tables.gait_rows(pd.DataFrame([row, {**row, "duty_factor": band.low}]), 4.0)}
    assert [value.human for value in rows["duty factor"].values] == [False, True]
    assert rows["stride length [m]"].values[0].text == "2.667"
    assert rows["steady speed [m/s]"].values[0].human is None
    joints = {**row, "positive_power_w_per_kg": 3.0, "positive_power_without_retraction_w_per_kg": np.nan}
    springs = {**joints, "positive_power_without_retraction_w_per_kg": 1.0}
    rows = {row.label: row for row in tables.gait_rows(pd.DataFrame([springs, joints]), 4.0)}
    assert [value.human for value in rows["positive power [W/kg]"].values] == [None, False]
    assert rows["positive power [W/kg]"].band == "6.0 to 9.0"


def test_data_cannot_end_its_script() -> None:
    text = html.script_data({"name": "</script><script>alert(1)</script>"})
    assert "<" not in text
    assert json.loads(text)["name"].startswith("</script>")
