"""curve.csv and what a stage prints."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest
from rich.console import Console

from romgrl.runtime import stage_log
from romgrl.runtime.stage_log import TerminalLog, format_duration, make_bars, make_console


def test_curve_widens_when_a_metric_appears(tmp_path: Path) -> None:
    sent: list[tuple[dict[str, float], int]] = []
    with TerminalLog("student", tmp_path, sink=lambda values, step: sent.append((dict(values), step))) as log:
        log.metrics({"loss": 1.0}, 10)
        log.metrics({"accuracy": 0.5, "loss": 2.0}, 20)
        log.metrics({"loss": 3.0}, 30)
    assert (tmp_path / "curve.csv").read_text(encoding="utf-8").split() == [
        "step,loss,accuracy",
        "10,1.0,",
        "20,2.0,0.5",
        "30,3.0,",
    ]
    assert sent == [({"loss": 1.0}, 10), ({"accuracy": 0.5, "loss": 2.0}, 20), ({"loss": 3.0}, 30)]


def test_without_a_terminal_lines_come_now_and_then(tmp_path: Path) -> None:
    console = Console(file=io.StringIO(), width=200)
    with TerminalLog("student", tmp_path, bars=make_bars(console)) as log:
        for step in range(1000):
            log.progress(step, 1000, speed=3.5)
        log.message("[bold]16 of 16 upright")
    assert console.file.getvalue() == "student: [bold]16 of 16 upright\n"


def test_progress_costs_little(tmp_path: Path) -> None:
    """A thousand calls in well under a tenth of a second, on a terminal too."""
    bars = make_bars(Console(file=io.StringIO(), force_terminal=True, width=120))
    with bars, TerminalLog("x", tmp_path, bars=bars) as log:
        start = time.perf_counter()
        for step in range(1000):
            log.progress(step, 1000, speed=3.5, episode=2.0)
        assert time.perf_counter() - start < 0.3


def test_durations() -> None:
    assert [format_duration(seconds) for seconds in (0, 59.6, 3599, 3600 + 61)] == ["0:00", "1:00", "59:59", "1:01:01"]


def test_a_resumed_curve_has_every_row_once(tmp_path: Path) -> None:
    """Rows after the checkpoint are made again; the tracker, which has some of them, gets only the new ones."""
    sent: list[int] = []
    for rows in ([10, 20, 30], [20, 30, 40]):
        with TerminalLog("teacher", tmp_path, sink=lambda values, step: sent.append(step)) as log:
            if sent:
                with (tmp_path / "curve.csv").open("a", encoding="utf-8") as file:
                    file.write("35,0.")  # the process died while it wrote
                log.resumed(15)
            for step in rows:
                log.metrics({"loss": step / 10}, step)
    assert sent == [10, 20, 30, 40]
    assert (tmp_path / "curve.csv").read_text(encoding="utf-8").splitlines() == [
        "step,loss",
        "10,1.0",
        "20,2.0",
        "30,3.0",
        "40,4.0",
    ]


def test_no_control_characters_where_there_is_no_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where CI asks every program for colours."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr(stage_log, "PLAIN_INTERVAL", 0.0)
    monkeypatch.setattr(stage_log.time, "monotonic", iter(range(100)).__next__)
    bars = make_bars(make_console())
    bars.add_task("sweep", total=3, completed=1, speed="", numbers="job 2")
    with bars, TerminalLog("student", tmp_path, bars=bars) as log:
        log.progress(0, 4000, speed=3.5)
        log.progress(1000, 4000, speed=3.5)
        log.message("[bold]done")
    bars.console.print("[bold]told")
    printed = capsys.readouterr().out.splitlines()
    assert printed[1:] == ["student: 1,000/4,000, 1,000 steps/s, 0:03 left, speed 3.5", "student: [bold]done", "told"]


def test_a_sweep_has_a_bar_above_those_of_its_stages(tmp_path: Path) -> None:
    bars = make_bars(Console(file=io.StringIO(), force_terminal=True, width=120))
    bars.add_task("sweep", total=3, completed=1, speed="", numbers="job 2")
    with TerminalLog("student", tmp_path, bars=bars) as log:
        log.progress(1000, 4000, speed=3.5)
        console = Console(file=io.StringIO(), width=120)
        console.print(bars.get_renderable())
        first, second = console.file.getvalue().splitlines()
    assert all(text in first for text in ("sweep", "33%", "job 2"))
    assert all(text in second for text in ("student", "25%", "speed 3.5"))
