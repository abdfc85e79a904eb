"""What the tests of pages of cells share: what they ask of a page, and pictures of it."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Browser

from tests.browser.conftest import SCREENSHOTS, SCROLL, watch

DRAWN = "() => [...charts.values()].every((chart) => chart.cursors || document.getElementById(chart.key).hidden)"
PAINTED = """() => {
  const { width, height } = canvas;
  const bytes = canvas.getContext("2d").getImageData(0, 0, width, Math.round(height * 0.8)).data;
  return bytes.filter((value, place) => place % 4 === 3 && value > 0).length;
}"""  # pixels above the ground
RING = """(key) => {
  const chart = charts.get(key);
  const { xaxis, yaxis } = chart.plot._fullLayout;
  const ring = chart.plot.querySelector(".cursor").getBoundingClientRect();
  const box = chart.plot.getBoundingClientRect();
  const [x, y] = pointAt(Object.keys(chart.cursor)[0], Object.values(chart.cursor)[0]);
  return Math.hypot(ring.left + ring.width / 2 - box.left - xaxis._offset - xaxis.l2p(x),
    ring.top + ring.height / 2 - box.top - yaxis._offset - yaxis.l2p(y));
}"""
WINDOWS = {"phone": (390, 844), "desktop": (1400, 900)}


def take_picture(browser: Browser, page_file: Path, kind: str, window: str, scheme: str) -> None:
    """A picture of the whole page with its table open, which fits into the window and is drawn without a fault."""
    width, height = WINDOWS[window]
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=scheme, has_touch=window == "phone"
    )
    page = context.new_page()
    faults, _ = watch(page)
    page.goto(page_file.as_uri())
    page.evaluate(SCROLL)
    page.wait_for_function(DRAWN)
    page.locator("details:has(#cell-table) > summary").click()
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=SCREENSHOTS / f"{kind}-{window}-{scheme}.png", full_page=True)
    assert page.locator("#cell-table").is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(PAINTED) > 500
    assert faults == []
    context.close()
