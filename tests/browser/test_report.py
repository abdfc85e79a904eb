"""The report in a real browser: the player moves, the curves have data, nothing is asked of a network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page

from tests.browser.conftest import SCREENSHOTS, SCROLL, watch

pytestmark = [pytest.mark.slow, pytest.mark.browser]

PAINT = 1000.0  # ms
FRAMES = 30.0  # 1/s
TIME = "time"
DRAWN = "() => [...charts.values()].every((chart) => chart.cursors)"
COUNT_FRAMES = """() => new Promise((resolve) => {
  const drawn = drawScene, begin = performance.now();
  let frames = 0;
  drawScene = (time) => { frames += 1; return drawn(time); };
  play(true);
  setTimeout(() => { play(false); drawScene = drawn; resolve(1000 * frames / (performance.now() - begin)); }, 4000);
})"""
RECORD_TIMES = """() => {
  const drawn = drawScene;
  window.seen = [];
  drawScene = (time) => { seen.push(time); return drawn(time); };
}"""
CURSOR_ERRORS = """() => [...charts.values()].filter((chart) => chart.cursor === "time").map((chart) => {
  const axis = chart.plot._fullLayout.xaxis;
  const line = chart.plot.querySelector(".cursor.line").getBoundingClientRect();
  return Math.abs(line.left - chart.plot.getBoundingClientRect().left - axis._offset - axis.d2p(time));
})"""
DOT_ERRORS = """() => [...charts.values()].filter((chart) => chart.key.startsWith("portrait")).flatMap((chart) =>
  chart.plot.data.map((trace) => {
    const { xaxis, yaxis } = chart.plot._fullLayout;
    const dot = chart.plot.querySelector(`.cursor.${trace.name}`).getBoundingClientRect();
    const box = chart.plot.getBoundingClientRect();
    const step = Math.round(time / scene.dt) - walkers[trace.name].offset;
    const x = dot.left + dot.width / 2 - box.left - xaxis._offset - xaxis.d2p(chart.cursor[trace.name].x[step]);
    const y = dot.top + dot.height / 2 - box.top - yaxis._offset - yaxis.d2p(chart.cursor[trace.name].y[step]);
    return Math.hypot(x, y);
  }))"""


def clock(page: Page) -> float:
    """The player's time in s."""
    return float(page.evaluate(TIME))


def picture(page: Page) -> str:
    """What the player shows."""
    return str(page.evaluate("document.getElementById('stage').toDataURL()"))


def test_player_plays_pauses_and_scrubs(opened: Page) -> None:
    start, before = clock(opened), picture(opened)
    opened.get_by_role("button", name="Play").click()
    opened.wait_for_function(f"() => time > {start} + 0.5")
    opened.get_by_role("button", name="Pause").click()
    stopped, after = clock(opened), picture(opened)
    assert after != before
    opened.wait_for_timeout(300)
    assert (clock(opened), picture(opened)) == (stopped, after)
    opened.get_by_label("Time in seconds").fill("7.25")
    assert clock(opened) == pytest.approx(7.25)
    assert picture(opened) != after
    assert opened.locator("#clock").inner_text() == "7.25 of 9.97 s"


def test_keys(opened: Page) -> None:
    opened.keyboard.press("Home")
    assert clock(opened) == 0.0
    opened.keyboard.press("ArrowRight")
    assert clock(opened) == pytest.approx(1 / 30, abs=1e-3)
    opened.keyboard.press("Shift+ArrowRight")
    assert clock(opened) == pytest.approx(11 / 30, abs=1e-3)
    opened.keyboard.press("ArrowDown")
    assert opened.locator("#speed").input_value() == "0.5"
    opened.keyboard.press("End")
    assert clock(opened) == pytest.approx(299 / 30, abs=1e-3)
    for key in ("1", "2", "3"):
        shown = picture(opened)
        opened.keyboard.press(key)
        assert picture(opened) != shown
    opened.keyboard.press("Space")
    opened.wait_for_function("() => playing")


def test_speed_and_loop_of_one_stride(opened: Page) -> None:
    opened.evaluate("seek(5)")
    opened.keyboard.press("l")
    start, stop = opened.evaluate("span")
    assert start <= 5 < stop
    assert stop - start == pytest.approx(1 / 1.8, abs=0.04)
    opened.locator("#speed").select_option("2")
    opened.keyboard.press("Space")
    opened.evaluate(RECORD_TIMES)
    opened.wait_for_function("() => seen.some((t, i) => i && t < seen[i - 1])")
    assert opened.evaluate(f"seen.filter((t) => t < {start} || t > {stop})") == []


def test_cursors_follow_the_player(opened: Page) -> None:
    opened.evaluate(SCROLL)
    opened.wait_for_function(DRAWN)
    for seconds in (3.0, 8.5):
        opened.evaluate(f"seek({seconds}); for (const chart of charts.values()) placeCursor(chart, time)")
        errors = opened.evaluate(CURSOR_ERRORS)
        assert len(errors) == 7  # five channels, the speed, the footfall
        assert max(errors) < 1.0  # pixels
        dots = opened.evaluate(DOT_ERRORS)
        assert len(dots) == 9
        assert max(dots) < 1.0


@pytest.mark.parametrize("key", ["channel-pelvis_y", "footfall"])
def test_a_click_on_a_curve_goes_there(opened: Page, key: str) -> None:
    plot = opened.locator(f"#{key} .plot")
    plot.scroll_into_view_if_needed()
    opened.wait_for_function(f"() => charts.get('{key}').cursors")
    plot.locator(".nsewdrag").click(position={"x": 200, "y": 60})
    at = opened.evaluate(f"charts.get('{key}').plot._fullLayout.xaxis.p2d(200)")
    assert clock(opened) == pytest.approx(at, abs=0.02)


def test_every_curve_has_data(opened: Page) -> None:
    opened.evaluate(SCROLL)
    opened.wait_for_function(DRAWN)
    found = opened.evaluate("""() => [...charts.values()].map((chart) => [chart.key, chart.plot.data.length,
      chart.plot.querySelectorAll(".trace path, .bars path").length])""")
    assert len(found) == 28
    assert all(traces > 0 and paths > 0 for _, traces, paths in found), found
    assert opened.locator("#channel-pelvis_y .scatterlayer .trace").count() == 3
    assert opened.locator("table").count() == 5
    assert "c0ffee" in opened.locator("main").inner_text()
    assert "standing still from step 20,480 to 40,960" in opened.locator("main").inner_text()


def test_in_a_sandboxed_frame(browser: Browser, page_file: Path, tmp_path: Path) -> None:
    outer = tmp_path / "outer.html"
    outer.write_text(
        f'<iframe sandbox="allow-scripts" width="1200" height="800" src="{page_file.as_uri()}"></iframe>',
        encoding="utf-8",
    )
    page = browser.new_page()
    faults, _ = watch(page)
    page.goto(outer.as_uri())
    frame = page.frames[1]
    frame.evaluate(SCROLL)
    frame.wait_for_function(DRAWN)
    frame.locator("#play").click()
    frame.wait_for_function("() => time > 3")
    assert frame.evaluate("origin") == "null"
    assert faults == []
    page.close()


def test_first_paint_and_frames(opened: Page) -> None:
    paint = opened.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    opened.evaluate("document.getElementById('channel-pelvis_y').scrollIntoView({block: 'end'})")
    opened.wait_for_timeout(1500)
    frames = opened.evaluate(COUNT_FRAMES)
    print(f"first paint after {paint:.0f} ms, {frames:.0f} frames/s")
    assert paint < PAINT
    assert frames >= FRAMES


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("name", "width", "height"), [("phone", 390, 844), ("desktop", 1440, 900)])
def test_screenshots(browser: Browser, page_file: Path, scheme: str, name: str, width: int, height: int) -> None:
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=scheme,
        has_touch=name == "phone",
    )
    page = context.new_page()
    faults, _ = watch(page)
    page.goto(page_file.as_uri())
    page.evaluate("seek(6.1)")
    page.evaluate(SCROLL)
    page.wait_for_function(DRAWN)
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    path = SCREENSHOTS / f"report-{name}-{scheme}.png"
    page.screenshot(path=path, full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert faults == []
    context.close()
    pixels = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3).astype(int)
    light = (pixels.mean(axis=1) > 128).mean()
    assert light > 0.7 if scheme == "light" else light < 0.3
    for color in ((0, 114, 178), (213, 94, 0), (0, 158, 115)):
        assert (np.abs(pixels - color).max(axis=1) < 12).mean() > 2e-4


def test_a_change_of_the_scheme_reaches_the_charts(opened: Page) -> None:
    opened.evaluate(SCROLL)
    opened.wait_for_function(DRAWN)
    label = "getComputedStyle(document.querySelector('#channel-speed .xtick text')).fill"
    light = opened.evaluate(label)
    opened.emulate_media(color_scheme="dark")
    opened.wait_for_function(f"() => {label} !== '{light}'")
    assert opened.evaluate(label) == "rgb(232, 232, 230)"
