"""Headless Chromium, and a finished report to open in it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from romgrl.humanoid.model import build
from romgrl.stages import report, report_page
from romgrl.stages.wiring.artifact_arrays import read_rollouts
from tests.browser.walkers import EPISODES, write_run
from tests.conftest import Composer

STEPS = 300  # 10 s
SCREENSHOTS = Path(os.environ.get("ROMGRL_SCREENSHOTS", Path(__file__).parents[2] / "outputs" / "screenshots"))
SCROLL = """async () => {
  for (let y = 0; y < document.body.scrollHeight; y += innerHeight / 2) {
    scrollTo(0, y);
    await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
  }
  scrollTo(0, 0);
}"""  # so that every chart is seen in a frame, and drawn


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium of the system."""
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no Chromium: make test-browser installs it")
    arguments = ["--no-sandbox"] if os.getuid() == 0 else []  # Chromium's own sandbox refuses root
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=path, args=arguments)
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def page_file(compose_config: Composer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """report.html of walkers whose legs swing at 1.75 and 2.4 strides per second."""
    folder = tmp_path_factory.mktemp("report")
    inputs = write_run(folder, steps=STEPS)
    config = compose_config("experiment=smoke", "threads=1", "speed=4", f"paths.outputs={folder}/outputs")
    config.evaluation = replace(config.evaluation, episodes=EPISODES, steps=STEPS, window=100)
    tables = {name: pd.read_csv(inputs["evaluation"] / f"{name}.csv") for name in ("mse", "gait", "null_models")}
    model = build()
    rollouts = read_rollouts(inputs["evaluation"], config, model.nq + model.nv)
    facts = report.collect_facts(config, inputs)
    report_page.write_page(
        config,
        inputs,
        folder,
        model=model,
        rollouts=rollouts,
        errors=tables["mse"],
        gaits=tables["gait"],
        nulls=tables["null_models"],
        facts=facts,
    )
    return folder / report_page.PAGE_FILE


@pytest.fixture
def opened(browser: Browser, page_file: Path) -> Iterator[Page]:
    """The report in a window of 1440 x 900; by the end of the test no error on its console, no request to anywhere."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="light")
    page = context.new_page()
    faults, requests = watch(page)
    page.goto(page_file.as_uri())
    yield page
    assert faults == []
    assert requests == [page_file.as_uri()]
    context.close()


def watch(page: Page) -> tuple[list[str], list[str]]:
    """Faults on the console and addresses that the page asks for; both grow."""
    faults: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: faults.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: requests.append(request.url) if not request.url.startswith("data:") else None)
    return faults, requests
