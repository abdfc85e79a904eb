"""The library's page in a real browser: a cell walks, the slider goes over to another, no network is asked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from romgrl.report.page.library_page import write_library_page
from tests.browser.cell_pages import DRAWN, PAINTED, RING, WINDOWS, take_picture
from tests.browser.conftest import SCROLL
from tests.helpers.synthetic_library import REASON, synthetic_library

pytestmark = [pytest.mark.slow, pytest.mark.browser]

REFUSED = 8  # the cell at 4 m/s, walking, on the softer legs


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """report.html of a library of two gaits at three speeds on two stiffnesses, one cell of which fell."""
    path = tmp_path_factory.mktemp("library") / "report.html"
    table, arrays = synthetic_library(gaits=("walk", "run"), fallen=(REFUSED,))
    table["foot_radius_m"] = table.gait.map({"walk": 0.07, "run": 0.09})
    table["roll_over_radius_m"] = table.gait.map({"walk": 0.3, "run": 0.0})
    write_library_page(path, table, arrays)
    return path


def state(page: Page) -> tuple[Any, ...]:
    """The cell, what is said of it, and its numbers."""
    numbers = page.locator("#numbers td").all_inner_texts()
    return page.evaluate("cell"), page.locator("#asked").inner_text(), page.locator("#verdict").inner_text(), numbers


def test_the_slider_goes_over_to_another_cell(opened: Page) -> None:
    opened.get_by_label("Asked for", exact=True).fill("0")
    slow = state(opened)
    opened.get_by_label("Asked for", exact=True).fill("1")
    fast = state(opened)
    assert (slow[1], fast[1]) == ("2 m/s", "3 m/s")
    assert all(one != other for one, other in zip(slow[3], fast[3], strict=True))
    assert fast[3] == opened.evaluate("cells[cell].numbers")
    assert opened.evaluate(PAINTED) > 500


def test_it_walks_on_from_the_same_phase(opened: Page) -> None:
    opened.keyboard.press("Space")
    opened.wait_for_function("() => walk.phase > 3.5 && walk.gone > 5")  # over the end of a stretch, on and on
    opened.keyboard.press("Space")
    before = opened.evaluate("[walk.phase, walk.gone, walk.seconds / (scene.dt * walkers[cell].strides[1])]")
    opened.keyboard.press("ArrowLeft")
    after = opened.evaluate("[walk.phase, walk.gone, walk.seconds / (scene.dt * walkers[cell].strides[1])]")
    assert after == pytest.approx(before)
    opened.evaluate("advance(0.4)")
    strides, metres = opened.evaluate("[walk.phase, walk.gone]")
    length = opened.evaluate("scene.dt * walkers[cell].strides[1]")
    assert strides - before[0] == pytest.approx(0.4 / length)
    assert metres - before[1] == pytest.approx(0.4 * opened.evaluate("cells[cell].asked"), abs=0.02)


def test_a_change_while_it_plays_is_no_jump(opened: Page) -> None:
    """At once it is drawn as before, and as the other cell a moment later."""
    opened.evaluate("playing = true; advance(0.25)")
    drawn = opened.evaluate("[...walk.pose.points]")
    other = opened.evaluate("choose(lines[0].cells[0]), [...walk.recorded.points]")
    assert opened.evaluate("[...walk.pose.points]") == pytest.approx(drawn, abs=1e-5)
    assert other != pytest.approx(drawn, abs=1e-2)
    opened.evaluate("advance(CHANGE)")
    arrived = opened.evaluate("[walk.pose, walk.recorded]")
    assert arrived[0] == arrived[1]


def test_keys_and_choices(opened: Page) -> None:
    opened.keyboard.press("ArrowLeft")
    assert state(opened)[1] == "2 m/s"
    opened.keyboard.press("ArrowLeft")
    assert state(opened)[1] == "2 m/s"
    opened.get_by_label("Gait").select_option("walk")
    opened.get_by_label("Stiffness").select_option("0.7")
    feet = "scene.foot_radius, scene.roll_over_radius"
    assert opened.evaluate(f"[line.gait, line.share, {feet}]") == ["walk", 0.7, 0.07, 0.3]
    assert opened.evaluate(f"choose(lines.find((each) => each.gait === 'run').cells[0]), [{feet}]") == [0.09, 0]
    opened.evaluate("choose(lines.find((each) => each.gait === 'walk' && each.share === 0.7).cells[0])")
    visible = opened.locator(".grid.footfall figure:visible figcaption").all_inner_texts()
    assert visible == ["walk, stiffness × 0.7"]
    opened.locator("body").click(position={"x": 2, "y": 2})
    opened.evaluate("document.activeElement.blur()")
    opened.keyboard.press("ArrowRight")
    opened.keyboard.press("ArrowRight")
    assert opened.evaluate("cell") == REFUSED
    assert state(opened)[2] == f"Refused: {REASON}."
    picture = opened.evaluate("canvas.toDataURL()")
    opened.evaluate("play(true)")
    opened.wait_for_timeout(300)
    assert opened.evaluate("canvas.toDataURL()") == picture  # no steady stretch: nothing moves
    opened.keyboard.press("ArrowDown")
    assert opened.locator("#speed").input_value() == "0.5"


def test_charts_follow_and_a_click_plays_that_cell(opened: Page) -> None:
    opened.evaluate(SCROLL)
    opened.wait_for_function(DRAWN)
    opened.evaluate("choose(lines[1].cells[0])")
    for key in ("atlas-duty_factor", "atlas-falls", "footfall-1"):
        opened.evaluate(f"charts.get('{key}').plot.scrollIntoView({{block: 'center'}})")
        opened.wait_for_function(f"() => charts.get('{key}').cursors && visible.has(charts.get('{key}'))")
        opened.evaluate("placeCursors(0)")
        assert opened.evaluate(RING, key) < 1.0  # pixels
    plot = opened.locator("#atlas-duty_factor .plot")
    plot.scroll_into_view_if_needed()
    target = opened.evaluate("""() => {
      const { xaxis, yaxis } = charts.get("atlas-duty_factor").plot._fullLayout;
      const number = lines[3].cells[2];
      return [xaxis.l2p(cells[number].asked), yaxis.l2p(charts.get("atlas-duty_factor").cursor.cell.y[number])];
    }""")
    plot.locator(".nsewdrag").click(position={"x": target[0], "y": target[1]})
    opened.wait_for_function("() => cell === lines[3].cells[2]")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("window", WINDOWS)
def test_pictures(browser: Browser, page_file: Path, window: str, scheme: str) -> None:
    take_picture(browser, page_file, "library", window, scheme)
