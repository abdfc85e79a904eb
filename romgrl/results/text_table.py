"""A table of texts that a terminal and a document show alike, and a number over seeds as such a text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from romgrl.report.markdown_table import markdown_table
from romgrl.report.numbers import significant
from romgrl.results.statistics import Interval, Summary

BRACKETS = "[ ] the 95 % interval over seeds, ( ) the smallest and largest of fewer than five"  # what with_range writes


@dataclass(frozen=True)
class Sheet:
    """Rows of texts; `names`: the columns of words, the others are numbers and stand to the right; `file`: its CSV."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    names: tuple[str, ...]
    file: str = ""

    def rich(self) -> Table:
        """For a terminal."""
        table = Table(title=self.title, title_justify="left")
        for column in self.columns:
            table.add_column(column, justify="left" if column in self.names else "right")
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        """For a document, without the title."""
        right = [i for i, column in enumerate(self.columns) if column not in self.names]
        return markdown_table(self.columns, self.rows, right)


def with_interval(estimate: float, ends: Interval) -> str:
    """`66.1 [60.2, 71.3]`; without brackets where there is no interval."""
    text = significant(estimate)
    return f"{text} [{significant(ends.low)}, {significant(ends.high)}]" if ends.known else text


def with_range(estimate: float, ends: Interval, smallest: float, largest: float, count: int) -> str:
    """The same; `66.1 (60.2 to 71.3)`, the smallest and largest of `count` numbers, where there is no interval."""
    if ends.known or count < 2 or not math.isfinite(estimate):
        return with_interval(estimate, ends)
    return f"{significant(estimate)} ({significant(smallest)} to {significant(largest)})"


def mean_text(summary: Summary) -> str:
    """The mean over seeds with its interval or range."""
    return with_range(summary.mean, summary.mean_interval, summary.smallest, summary.largest, len(summary.values))


def middle_text(summary: Summary) -> str:
    """The interquartile mean over seeds with its interval or range."""
    return with_range(summary.iqm, summary.iqm_interval, summary.smallest, summary.largest, len(summary.values))
