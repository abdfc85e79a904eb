"""The one writer of tables in Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int] = ()) -> str:
    """Rows of texts below the names of their columns; those of the indices `right` stand to the right."""
    lines = [
        _line(columns),
        "|" + "|".join("---:" if column in right else "---" for column in range(len(columns))) + "|",
        *map(_line, rows),
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
