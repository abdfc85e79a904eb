"""Headless Chromium, and a finished report to open in it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from romgrl.gait.features import Gait
from romgrl.humanoid.model import build
from romgrl.stages import report, report_page
from tests.conftest import Composer
from tests.gait.synthetic import DT, run
from tests.report import finished

STEPS = 300  # 10 s
SCREENSHOTS = Path(os.environ.get("ROMGRL_SCREENSHOTS", Path(__file__).parents[2] / "outputs" / "screenshots"))


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
    model = build()
    gaits = {
        "teacher": walker(1.75, steps=250, episodes=4),
        "student": walker(1.8, height=0.87, noise=0.01),
        "baseline": walker(2.4, height=0.75, noise=0.01, amplitude=0.3),
    }
    states = {name: running(model, rate) for name, rate in (("student", 1.8), ("baseline", 2.4))}
    inputs = finished.write(folder, gaits, states, speed=4.0)
    finished.write_trainings(inputs)
    config = compose_config("experiment=smoke", "threads=1", "speed=4", f"paths.outputs={folder}/outputs")
    config.evaluation = replace(config.evaluation, episodes=8, steps=STEPS, window=100)
    tables = {name: pd.read_csv(inputs["evaluation"] / f"{name}.csv") for name in ("mse", "gait")}
    rollouts = report.read_rollouts(inputs["evaluation"], config, model.nq + model.nv)
    facts = report.collect_facts(config, inputs)
    report_page.write_page(
        config,
        inputs,
        folder,
        model=model,
        rollouts=rollouts,
        errors=tables["mse"],
        gaits=tables["gait"],
        facts=facts,
    )
    return folder / report_page.PAGE


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


def walker(rate: float, *, episodes: int = 8, steps: int = STEPS, **shape: float) -> Gait:
    """Episodes of a synthetic run at 4 m/s."""
    features, contact = run(episodes=episodes, steps=steps, frequency=rate, **shape)  # type: ignore[arg-type]
    size = features.shape[:2]
    return Gait(features, np.ones(size, bool), np.zeros(episodes, bool), DT, np.full(size, 4.0), contact)


def running(model: Any, rate: float) -> Any:
    """States (T, nq + nv) of a humanoid that moves forward at 4 m/s and swings its legs."""
    states = np.zeros((STEPS, model.nq + model.nv))
    time = DT * np.arange(STEPS)
    swing = np.sin(2 * np.pi * rate * time)
    for joint, angle in (("L_Hip", -0.5 * swing), ("R_Hip", 0.5 * swing), ("L_Knee", 0.6 + 0.4 * swing)):
        names = [index for index in range(model.njnt) if model.joint(index).name.startswith(joint)]
        states[:, model.jnt_qposadr[names[0]]] = angle
    states[:, 0], states[:, 1] = 4.0 * time, 0.9
    return states
