"""MLflow's own UI with a finished sweep: what README.md and docs/how-to.md promise of it is there."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
from playwright.sync_api import Browser, Frame, Page, expect

from romgrl.report.terminal_tables import HEADLINE, TRAINING_MINUTES
from romgrl.tracking.recorder import UI_ADDRESS
from tests.browser.conftest import SCREENSHOTS
from tests.helpers.jobs import start
from tests.helpers.limits import wait_until
from tests.helpers.ports import free_port
from tests.helpers.servers import answers, process

pytestmark = [pytest.mark.slow, pytest.mark.browser]

SWEEP = ("-m", "experiment=smoke", "eta=0.3,0.5", "reference.steps=1000")
MEASURED = ("evaluation.episodes=8", "evaluation.steps=110", "evaluation.window=100")
NOBODY = "/ajax-api/2.0/mlflow/users/current"  # who is signed in: a server without accounts has no such page
PATIENCE = 60_000  # ms, for an answer of the server


@dataclass(frozen=True)
class Swept:
    """What a sweep of two jobs printed, and the address of the server that shows it."""

    said: str
    server: str

    @property
    def jobs(self) -> str:
        """The address that the jobs printed, at this server."""
        (printed,) = set(re.findall(r"^(?:\[.*\] )?jobs, best first: (.*)$", self.said, re.MULTILINE))
        return str(printed).replace(UI_ADDRESS, self.server)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Swept]:
    """A finished sweep over eta, and the server that its jobs tell to start, on a port that is free."""
    outputs = tmp_path_factory.mktemp("sweep")
    job = start(*SWEEP, *MEASURED, f"paths.outputs={outputs}", module="tests.browser.recorded")
    said, errors = job.communicate(timeout=600)
    assert job.returncode == 0, errors
    (command,) = set(re.findall(r"compare runs: (.*)$", said, re.MULTILINE))
    port = free_port()
    quiet = ["env", "MLFLOW_DISABLE_TELEMETRY=true"]
    with (
        (outputs / "ui.log").open("w", encoding="utf-8") as log,
        process([*quiet, *shlex.split(command), "--port", str(port), "--workers", "1"], log.fileno()),
    ):
        server = f"http://127.0.0.1:{port}"
        wait_until(lambda: answers(f"{server}/health"))
        yield Swept(said, server)


Opened = Callable[[str], Page]


@pytest.fixture
def visit(browser: Browser, swept: Swept) -> Iterator[Opened]:
    """Open an address in a fresh browser without MLflow's assistant; by the end no error, no request to elsewhere."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="light")
    context.set_default_timeout(PATIENCE)
    expect.set_options(timeout=PATIENCE)
    faults: list[str] = []
    elsewhere: list[str] = []
    context.on("weberror", lambda error: faults.append(str(error.error)))
    context.on(
        "console",
        lambda message: faults.append(f"{message.text} {message.location}") if message.type == "error" else None,
    )
    context.on("request", lambda request: elsewhere.append(request.url) if away(request.url, swept.server) else None)

    def opened(address: str) -> Page:
        page = context.new_page()
        page.goto(address)
        page.get_by_role("button", name="Close", exact=True).click()  # MLflow's assistant
        return page

    yield opened
    assert [fault for fault in faults if f"{swept.server}{NOBODY}" not in fault] == []
    assert elsewhere == []
    context.close()


def away(url: str, server: str) -> bool:
    """Tell whether an address is neither the server's nor within the page."""
    return not url.startswith((f"{server}/", f"blob:{server}/", "data:"))


def keep(page: Page, name: str, *, narrow: bool = True) -> None:
    """Pictures of what a page shows, on a phone without MLflow's side bar."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.wait_for_timeout(1000)
    page.screenshot(path=SCREENSHOTS / f"mlflow-{name}-desktop.png")
    if not narrow:
        return
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_role("button", name="Toggle sidebar").click()
    page.wait_for_timeout(1000)
    page.screenshot(path=SCREENSHOTS / f"mlflow-{name}-phone.png")
    page.get_by_role("button", name="Toggle sidebar").click()
    page.set_viewport_size({"width": 1440, "height": 900})


def section(page: Page, title: str) -> list[str]:
    """The lines of a section of the comparison, without its title and switch."""
    text = page.locator("main, #root").last.inner_text()
    found = re.search(rf"\n{title}\n+Show diff only\n(.*?)\n(?:Metrics|Artifacts|Tags)\n", text, re.DOTALL)
    assert found is not None, text
    return [line.strip() for line in found[1].splitlines() if line.strip()]


def test_three_clicks_compare_the_jobs_of_a_sweep(visit: Opened, swept: Swept) -> None:
    page = visit(swept.jobs)
    names = page.locator(".ag-pinned-left-cols-container, .ag-center-cols-container").get_by_role("link")
    best_first = [f"job v=4 eta={eta} noise=0.05 s=0" for eta in (0.3, 0.5)]
    expect(names.filter(has_text="job v=4")).to_have_text([re.compile(f"^{title} ") for title in best_first])
    keep(page, "jobs")
    page.locator(".ag-header input[type=checkbox]:visible").first.click()
    page.get_by_role("button", name="Compare", exact=True).click()
    expect(page.get_by_text("Comparing 2 Runs from 1 Experiment")).to_be_visible()
    page.get_by_text("Show diff only").first.click()
    expect(page.get_by_text("discriminator.batch_size", exact=True)).to_have_count(0)
    assert section(page, "Parameters") == ["eta\t0.3\t0.5"]
    assert section(page, "Metrics")[:10] == [*HEADLINE, TRAINING_MINUTES]
    assert all(title in page.locator("body").inner_text() for title in best_first)
    keep(page, "comparison", narrow=False)
    page.get_by_text("Show diff only").first.scroll_into_view_if_needed()
    keep(page, "differences")


def test_a_job_leads_to_its_report_which_plays_in_the_frame_of_artifacts(visit: Opened, swept: Swept) -> None:
    page = open_job(visit(swept.jobs))
    metrics = page.locator("[role=row], .row").get_by_text(re.compile(r"^\d\d_"))
    expect(metrics).to_have_text([*HEADLINE, TRAINING_MINUTES])
    keep(page, "job", narrow=False)
    artifacts = open_artifacts(page, "report")
    artifacts.get_by_text("report.html", exact=True).click()
    frame = report_frame(artifacts)
    frame.get_by_role("button", name="Play").click()
    frame.wait_for_function("() => time > 1")
    keep(artifacts, "report", narrow=False)
    artifacts.get_by_text("side_by_side.mp4", exact=True).click()
    artifacts.wait_for_function("() => document.querySelector('video')?.readyState >= 2")
    keep(artifacts, "film", narrow=False)
    artifacts.get_by_text("time_series.png", exact=True).click()
    artifacts.wait_for_function("() => [...document.images].some((image) => image.naturalWidth > 1000)")


def test_tables_of_two_jobs_stand_side_by_side(visit: Opened, swept: Swept) -> None:
    artifacts = open_artifacts(open_job(visit(swept.jobs)), "evaluation")
    artifacts.get_by_text("tables", exact=True).click()
    artifacts.get_by_text("mse.json", exact=True).click()
    expect(artifacts.get_by_text("average, aligned", exact=True)).to_be_visible()
    page = artifacts
    page.goto(swept.jobs.replace("%22job%22", "%22evaluation%22") + "&compareRunsMode=ARTIFACT")
    expect(page.get_by_text("mmd, all", exact=True)).to_be_visible()
    titles = [f"evaluation v=4 eta={eta} noise=0.05 s=0" for eta in (0.3, 0.5)]
    for title in titles:
        expect(page.get_by_role("link", name=re.compile(f"^{title}"))).to_have_count(2)  # in the list, above the column
    keep(page, "tables", narrow=False)


def open_job(page: Page) -> Page:
    """From the list of jobs to the best of them, its description unfolded."""
    page.get_by_role("link", name=re.compile("^job v=4 eta=0.3")).first.click()
    page.get_by_text("Show more", exact=True).first.click()
    return page


def open_artifacts(page: Page, stage: str) -> Page:
    """From a job, by the link of its description, to the artifacts of a stage."""
    with page.expect_popup() as popup:
        page.get_by_role("cell").get_by_role("link", name=stage, exact=True).click()
    popup.value.get_by_role("tab", name="Artifacts").click()
    return popup.value


def report_frame(page: Page) -> Frame:
    """The sandboxed frame in which MLflow shows a page, once that is drawn."""
    frame = page.locator("iframe")
    expect(frame).to_have_attribute("sandbox", "allow-scripts")
    found = frame.element_handle().content_frame()
    assert found is not None
    found.wait_for_function("() => typeof time === 'number'")
    return found
