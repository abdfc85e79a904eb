"""What a running stage says: a progress bar on the terminal, numbers over steps in curve.csv and to the tracker."""

from __future__ import annotations

import csv
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeRemainingColumn

WIDEST_TABLE = 160  # columns; wider than many terminals, so that no verdict is cut off
PLAIN_INTERVAL = 30.0  # seconds between progress lines where there is no terminal

MetricSink = Callable[[Mapping[str, float], int], None]


class StageLog(Protocol):
    """The voice of a stage. Steps are the stage's own count: environment steps in trainings."""

    def progress(self, step: int, total: int, **numbers: float) -> None:
        """Show `step` of `total` with the two or three numbers that matter; cheap enough to call at every step."""

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Record numbers at `step`: one row of curve.csv, and the tracker."""

    def resumed(self, step: int) -> None:
        """Go on after `step`: later rows of curve.csv are cut, and what the tracker has is not sent again."""

    def message(self, text: str) -> None:
        """Print one line without disturbing the bar."""


def format_duration(seconds: float) -> str:
    """Write a duration as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Curve:
    """curve.csv: `step` and one column per metric; a metric that appears later widens the table.

    A file that is already there is continued.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._columns: list[str] = ["step"]
        if path.exists() and path.stat().st_size:
            with path.open(newline="", encoding="utf-8") as file:
                self._columns = next(csv.reader(file))

    def append(self, values: Mapping[str, float], step: int) -> None:
        """Write one row; a metric that is absent leaves its cell empty."""
        new = [name for name in values if name not in self._columns]
        if new:
            self._widen(new)
        row: dict[str, float | int] = {"step": step, **values}
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow([row.get(column, "") for column in self._columns])

    def cut(self, step: int) -> int:
        """Drop the rows after a step, and a last one that was not written whole; returns the last step there was."""
        if not self._path.exists():
            return step
        text = self._path.read_text(encoding="utf-8")
        lines = list(csv.reader(text[: text.rfind("\n") + 1].splitlines()))
        kept = [line for line in lines[1:] if int(line[0]) <= step]
        write_rows(self._path, [self._columns, *kept])
        return max([step, *(int(line[0]) for line in lines[1:])])

    def _widen(self, new: list[str]) -> None:
        rows: list[list[str]] = []
        if self._path.exists():
            with self._path.open(newline="", encoding="utf-8") as file:
                rows = list(csv.reader(file))[1:]
        self._columns += new
        write_rows(self._path, [self._columns, *([*row, *[""] * len(new)] for row in rows)])


def write_rows(path: Path, rows: Iterable[Sequence[str]]) -> None:
    """Write a table whole or not at all."""
    temporary = path.with_name(f".{path.name}")
    with temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    temporary.replace(path)


def make_console() -> Console:
    """The console of a job. No bar, colour or other control character goes to a file or a pipe, whatever CI sets."""
    interactive = sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
    console = Console(force_terminal=None if interactive else False)
    console.width = max(console.width, 0 if interactive else WIDEST_TABLE)
    return console


def make_bars(console: Console) -> Progress:
    """Make the display of all running stages, a line each; draw it, on a terminal, by using it in a `with` block."""
    return Progress(
        SpinnerColumn(),
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:>3.0f}%"),
        TextColumn("{task.fields[speed]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[numbers]}"),
        console=console,
        transient=True,
        refresh_per_second=4,
        disable=not console.is_terminal,
    )


class TerminalLog:
    """The StageLog of the pipeline. Use as a context manager: its line in `bars` lives inside the `with` block."""

    def __init__(
        self, stage: str, output: Path, *, sink: MetricSink | None = None, bars: Progress | None = None
    ) -> None:
        self._stage = stage
        self._bars = bars or make_bars(Console())
        self._console = self._bars.console
        self._curve = Curve(output / "curve.csv")
        self._sink = sink
        self._start = self._last_plain = time.monotonic()
        self._first_step: int | None = None
        self._recorded = -1  # the last step that an earlier attempt recorded
        self._task: TaskID | None = None

    def __enter__(self) -> TerminalLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._task is not None:
            self._bars.remove_task(self._task)

    def progress(self, step: int, total: int, **numbers: float) -> None:
        now = time.monotonic()
        if self._first_step is None:
            self._first_step, self._start = step, now
        elapsed = now - self._start
        rate = (step - self._first_step) / elapsed if elapsed > 0 else math.nan
        if self._console.is_terminal:
            if self._task is None:
                self._task = self._bars.add_task(self._stage, total=total, speed="", numbers="")
            speed = f"{rate:,.0f} steps/s" if math.isfinite(rate) else ""
            shown = "  ".join(f"{name} {value:.3g}" for name, value in numbers.items())
            self._bars.update(self._task, completed=step, total=total, speed=speed, numbers=shown)
        elif now - self._last_plain >= PLAIN_INTERVAL:
            self._last_plain = now
            pace = f", {rate:,.0f} steps/s, {format_duration((total - step) / rate)} left" if rate > 0 else ""
            shown = "".join(f", {name} {value:.3g}" for name, value in numbers.items())
            self._console.print(f"{self._stage}: {step:,}/{total:,}{pace}{shown}", soft_wrap=True)

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        row = {name: float(value) for name, value in values.items()}
        self._curve.append(row, step)
        if self._sink is not None and step > self._recorded:
            self._sink(row, step)

    def resumed(self, step: int) -> None:
        self._recorded = self._curve.cut(step)

    def message(self, text: str) -> None:
        self._console.print(f"{self._stage}: {text}", soft_wrap=True, markup=False, highlight=False)


class SilentLog:
    """A StageLog that keeps its metrics in a list; for tests, scripts and benchmarks."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, dict[str, float]]] = []
        self.messages: list[str] = []

    def progress(self, step: int, total: int, **numbers: float) -> None:
        pass

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        self.rows.append((step, dict(values)))

    def resumed(self, step: int) -> None:
        self.rows = [row for row in self.rows if row[0] <= step]

    def message(self, text: str) -> None:
        self.messages.append(text)
