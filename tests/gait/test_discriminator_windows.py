"""What windows hold: frames k steps apart, velocities that are finite differences, and mirrors that mirror both."""

import numpy as np
import pytest
from numpy.typing import NDArray

from romgrl.gait.discriminator_windows import FrameWindows, WindowLayout, reference_windows, trunk_leans
from romgrl.gait.features import MIRROR

DT = 1 / 30
COLUMNS = {"paper": 5, "trunk": 6, "trunk_soles": 8, "velocities": 10, "trunk_velocities": 11}
FEATURES = tuple(COLUMNS)


def recorded(layout: WindowLayout, rows: int, seed: int = 0) -> NDArray[np.float32]:
    """Steps (rows, span, positions) with nothing in common."""
    shape = (rows, layout.span, layout.positions)
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("features", FEATURES)
@pytest.mark.parametrize(("window", "stride"), [(1, 1), (2, 1), (4, 1), (4, 4), (2, 3)])
def test_what_a_window_holds(features: str, window: int, stride: int) -> None:
    """Frame by frame: the positions of the step, the inclination, and the step's difference from the one before."""
    layout = WindowLayout(features, window, stride, DT)
    steps = recorded(layout, 3)
    frames = layout.windows(steps).reshape(3, window, COLUMNS[features])
    newest = layout.span - 1
    for i in range(window):
        step = newest - (window - 1 - i) * stride
        np.testing.assert_array_equal(frames[:, i, : layout.positions], steps[:, step])
        if layout.velocities:
            differences = (steps[:, step, :5] - steps[:, step - 1, :5]) * 30
            np.testing.assert_allclose(frames[:, i, layout.positions :], differences, rtol=1e-5, atol=1e-5)


def test_four_frames_four_steps_apart_span_0_43_seconds() -> None:
    assert WindowLayout("trunk", 4, 4, DT).span == 13
    assert WindowLayout("velocities", 4, 4, DT).span == 14


def test_velocities_of_a_known_motion() -> None:
    """x = 0.4 sin(2 pi 1.6 t): the finite difference is the derivative half a step earlier, times sinc."""
    rate, time = 2 * np.pi * 1.6, np.arange(60) * DT
    features = np.zeros((60, 5), np.float32)
    features[:, 1] = 0.4 * np.sin(rate * time)
    layout = WindowLayout("velocities", 1, dt=DT)
    windows = reference_windows(features, np.zeros(60, np.int32), layout=layout, trunk_std=0, mirror=False, seed=0)
    half = rate * DT / 2
    expected = 0.4 * rate * np.cos(rate * (time[1:] - DT / 2)) * np.sin(half) / half
    np.testing.assert_allclose(windows[:, 6], expected, atol=2e-5)


@pytest.mark.parametrize("features", FEATURES)
@pytest.mark.parametrize(("window", "stride"), [(1, 1), (2, 1), (4, 3)])
def test_mirror_of_a_window_is_the_window_of_the_mirror(features: str, window: int, stride: int) -> None:
    layout = WindowLayout(features, window, stride, DT)
    steps, mirror = recorded(layout, 5), layout.mirror()
    soles = steps[..., 6:][..., ::-1]
    swapped = np.concatenate((MIRROR.image(steps[..., :5]), steps[..., 5:6], soles), axis=-1)
    seen = layout.windows(steps)
    np.testing.assert_array_equal(mirror.image(seen), layout.windows(swapped))
    np.testing.assert_array_equal(mirror.image(mirror.image(seen)), seen)


@pytest.mark.parametrize("features", FEATURES)
def test_the_student_is_seen_as_the_reference_is(features: str) -> None:
    """Steps pushed one by one give the windows of a reference of the same steps; its soles are as far above the ground
    as its ankles are above their lowest."""
    layout = WindowLayout(features, 3, 2, DT)
    motion = 0.02 * np.random.default_rng(1).normal(size=(40, 5)).astype(np.float32)
    windows = FrameWindows(num_envs=2, layout=layout)
    ankles = motion[:, [2, 4]] + motion[:, :1]
    soles = ankles - ankles.min()
    seen = []
    for step, row in enumerate(motion):
        info = {"features": np.stack((row, row + 1)), "trunk_lean": np.zeros(2, np.float32)}
        frame = layout.frame(info | {"sole_height": np.stack((soles[step], soles[step] + 1))})
        if step == 0:
            windows.restart(frame)
        else:
            seen.append(windows.push(frame).copy())
    expected = reference_windows(motion, np.zeros(40, np.int32), layout=layout, trunk_std=0.0, mirror=False, seed=0)
    np.testing.assert_allclose(np.stack(seen)[layout.span - 2 :, 0], expected, atol=1e-5)


def test_soles_that_are_pressed_in_or_clear_of_the_ground_look_alike() -> None:
    layout = WindowLayout("trunk_soles", 1)
    info = {"features": np.zeros((2, 5), np.float32), "trunk_lean": np.zeros(2, np.float32)}
    soles = np.array([[-0.01, 0.004], [0.02, 0.4]], np.float32)
    seen = layout.frame(info | {"sole_height": soles})[:, 6:]
    np.testing.assert_allclose(seen, [[0.005, 0.005], [0.02, 0.03]], rtol=1e-6)
    np.testing.assert_array_equal(WindowLayout("trunk_soles", 2).weights(0.25), 2 * ([1.0] * 6 + [0.25] * 2))


def test_velocity_after_a_reset_is_that_of_the_first_step() -> None:
    windows = FrameWindows(num_envs=1, layout=WindowLayout("velocities", 2, dt=DT))
    first, second = np.full((1, 5), 1.0, np.float32), np.full((1, 5), 1.1, np.float32)
    windows.restart(first)
    old, new = windows.push(second).reshape(2, 10)
    np.testing.assert_allclose(old[5:], 0)
    np.testing.assert_allclose(new[5:], 3.0, rtol=1e-5)


def test_strided_windows_stay_within_episodes() -> None:
    features = np.arange(20, dtype=np.float32)[:, None] * np.ones(5, dtype=np.float32)
    episode = np.repeat([0, 1], [12, 8]).astype(np.int32)
    layout = WindowLayout("paper", 3, 4, DT)
    windows = reference_windows(features, episode, layout=layout, trunk_std=0, mirror=False, seed=0)
    np.testing.assert_array_equal(windows[:, ::5], [[0, 4, 8], [1, 5, 9], [2, 6, 10], [3, 7, 11]])
    with pytest.raises(ValueError, match="no episode"):
        reference_windows(features, episode, layout=WindowLayout("paper", 4, 4, DT), trunk_std=0, mirror=False, seed=0)


STD, TIME = 0.08, 0.1


def leans(count: int, span: int, time: float | None = TIME, dt: float = DT, seed: int = 0) -> NDArray[np.float32]:
    return trunk_leans(count, span, std=STD, time=time, dt=dt, seed=seed)


def test_the_lean_is_a_stationary_process() -> None:
    """At every step N(0, std), with the correlation of the docstring, 1/e after `time`; windows are independent."""
    lean = leans(20_000, 13)
    assert lean.dtype == np.float32
    np.testing.assert_allclose(lean.mean(0), 0, atol=4 * STD / np.sqrt(20_000))
    np.testing.assert_allclose(lean.std(0), STD, rtol=0.03)
    lag = np.abs(np.subtract.outer(np.arange(13), np.arange(13)))
    correlation = np.corrcoef(lean.T)
    np.testing.assert_allclose(correlation, np.exp(-((lag * DT / TIME) ** 2)), atol=0.03)
    np.testing.assert_allclose(correlation[lag == 3], np.exp(-1), atol=0.03)
    np.testing.assert_allclose(np.corrcoef(lean[:-1, 5], lean[1:, 5])[0, 1], 0, atol=0.03)


def test_the_lean_is_smooth() -> None:
    """It has a rate: differences shrink as the steps do, and those of the rate, too."""
    for dt in (TIME / 20, TIME / 40):
        rate = np.diff(leans(5_000, 9, dt=dt).astype(np.float64)) / dt
        np.testing.assert_allclose(rate.std(0), np.sqrt(2) * STD / TIME, rtol=0.05)
        assert np.abs(np.diff(rate)).max() < 6 * np.sqrt(12) * STD / TIME**2 * dt


@pytest.mark.filterwarnings("error")
def test_a_lean_that_takes_long_is_constant_within_a_window() -> None:
    slow, still = leans(2_000, 13, time=1000.0), leans(2_000, 13, time=None)
    assert np.ptp(slow, axis=1).max() < 5e-3 * STD
    assert not np.ptp(still, axis=1).any()
    np.testing.assert_allclose([slow[:, 0].std(), still[:, 0].std()], STD, rtol=0.06)
    once = np.random.default_rng(0).normal(0.0, STD, 2_000).astype(np.float32)
    np.testing.assert_array_equal(still[:, 0], once)


def test_the_seed_decides_the_lean() -> None:
    np.testing.assert_array_equal(leans(10, 4), leans(10, 4))
    assert not np.array_equal(leans(10, 4), leans(10, 4, seed=1))


@pytest.mark.parametrize("features", ["trunk", "trunk_velocities"])
def test_mirror_images_share_a_lean_that_moves(features: str) -> None:
    motion = np.random.default_rng(2).normal(size=(60, 5)).astype(np.float32)
    layout, episode = WindowLayout(features, 4, 1, DT), np.repeat([0, 1], 30).astype(np.int32)
    windows = reference_windows(motion, episode, layout=layout, trunk_std=STD, trunk_time=TIME, mirror=True, seed=0)
    lean = windows.reshape(-1, 2, 4, layout.columns)[..., 5]
    np.testing.assert_array_equal(lean[:, 0], lean[:, 1])
    assert (np.diff(lean) != 0).all()
    still = reference_windows(motion, episode, layout=layout, trunk_std=STD, mirror=True, seed=0)
    others = np.delete(np.arange(layout.columns), 5)
    frames, same = (each.reshape(-1, 4, layout.columns)[..., others] for each in (windows, still))
    np.testing.assert_array_equal(frames, same)
