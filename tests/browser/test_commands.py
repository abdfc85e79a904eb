"""The page of a student that follows commands in a browser: cells, gaits, the reference beside it, and the ramp."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from romgrl.runtime.stage_log import SilentLog
from romgrl.stages import grid_report
from tests.browser.cell_pages import DRAWN, PAINTED, RING, WINDOWS, take_picture
from tests.browser.conftest import SCROLL
from tests.conftest import Composer
from tests.helpers.commanded import commanded
from tests.helpers.synthetic_grid import FALLS, write_grid

pytestmark = [pytest.mark.slow, pytest.mark.browser]


@pytest.fixture(scope="module")
def page_file(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """report.html of runs and walks, one cell of which falls, and a ramp; without a film."""
    folder = tmp_path_factory.mktemp("commands")
    config = commanded(compose_config, "evaluation.video=false")
    (folder / "report").mkdir()
    grid_report.run(config, write_grid(folder / "in"), folder / "report", SilentLog())
    return folder / "report" / "report.html"


def test_slider_gait_and_verdict(opened: Page) -> None:
    opened.get_by_label("Gait").select_option("run")
    opened.get_by_label("Speed asked for").fill("0")
    assert opened.evaluate("[cell, line.gait]") == [0, "run"]
    assert opened.locator("#asked").inner_text() == "2 m/s"
    numbers = opened.locator("#numbers td").all_inner_texts()
    assert numbers[:3] == ["2.02", "1.80", "2.00"]
    opened.get_by_label("Speed asked for").fill("2")
    assert opened.evaluate("cell") == FALLS
    assert opened.locator("#verdict").inner_text().startswith("Not held: 4.6 m/s; falls in 8 of 8 episodes")
    assert "refused" in (opened.locator("#verdict").get_attribute("class") or "")
    opened.evaluate("document.activeElement.blur()")
    opened.keyboard.press("ArrowLeft")
    assert opened.evaluate("cell") == 1
    assert opened.locator(".grid.footfall figure:visible figcaption").all_inner_texts() == ["run"]


def test_student_and_reference_walk_beside_one_another(opened: Page) -> None:
    """Each by its own strides; S brings them in step, A draws one over the other."""
    opened.evaluate("choose(0), advance(1.0)")
    phases = opened.evaluate("walks.map((walk) => walk.phase)")
    lengths = opened.evaluate("walks.map(({ walker }) => scene.dt * (walker.strides[1] - walker.strides[0]))")
    assert phases == pytest.approx([1.0 / length for length in lengths])
    opened.evaluate("teacher.phase = 0.2")
    opened.keyboard.press("s")
    assert opened.evaluate("teacher.phase - student.phase") == 0.0
    pictures = [opened.evaluate("canvas.toDataURL()")]
    assert opened.evaluate(PAINTED) > 5000
    opened.keyboard.press("a")
    pictures.append(opened.evaluate("canvas.toDataURL()"))
    assert pictures[0] != pictures[1]
    assert opened.locator("#apart").get_attribute("aria-pressed") == "false"


def test_the_ramp_plays_and_its_charts_follow(opened: Page) -> None:
    opened.evaluate(SCROLL)
    opened.wait_for_function(DRAWN)
    opened.keyboard.press("r")
    assert opened.locator("#scrub").is_visible()
    assert not opened.locator("#cells").is_visible()
    opened.evaluate("advance(20)")
    assert opened.locator("#verdict").inner_text() == "asked 3.50 m/s, run; held 3.50 m/s, 1.50 strides/s, run"
    assert opened.locator("#asked").inner_text() == "20.0 s"
    plot = opened.locator("#ramp-speed .plot")
    plot.scroll_into_view_if_needed()
    opened.wait_for_function("() => visible.has(charts.get('ramp-speed'))")
    opened.evaluate("show()")
    assert opened.locator("#ramp-speed .cursor").is_visible()
    box = plot.bounding_box()
    assert box is not None
    plot.click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
    assert opened.evaluate("rampTime") == pytest.approx(26.0, abs=4.0)
    opened.keyboard.press("ArrowLeft")
    opened.keyboard.press("r")
    assert opened.locator("#numbers").is_visible()
    assert not opened.locator("#ramp-speed .cursor").is_visible()


def test_rings_and_clicks(opened: Page) -> None:
    opened.evaluate(SCROLL)
    opened.wait_for_function(DRAWN)
    opened.evaluate("choose(1)")
    for key in ("grid-duty_factor", "grid-error_over_variance", "footfall-0"):
        opened.evaluate(f"charts.get('{key}').plot.scrollIntoView({{block: 'center'}})")
        opened.wait_for_function(f"() => charts.get('{key}').cursors && visible.has(charts.get('{key}'))")
        opened.evaluate("placeCursors(-1)")
        if key != "grid-error_over_variance":  # whose axis Plotly counts in other units
            assert opened.evaluate(RING, key) < 1.0  # pixels
        assert opened.locator(f"#{key} .cursor").is_visible()
    opened.evaluate("pick({ customdata: 3 })")
    assert opened.evaluate("[cell, line.gait]") == [3, "walk"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("window", WINDOWS)
def test_pictures(browser: Browser, page_file: Path, window: str, scheme: str) -> None:
    take_picture(browser, page_file, "commands", window, scheme)
