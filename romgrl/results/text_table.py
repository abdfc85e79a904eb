"""A table of texts that a terminal and a document show alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from romgrl.report.markdown_table import markdown_table


@dataclass(frozen=True)
class Sheet:
    """Rows of texts; `names`: the columns of words, the others are numbers and stand to the right."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    names: tuple[str, ...]

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
