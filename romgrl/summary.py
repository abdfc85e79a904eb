"""The table of results that ends a run, from the CSV files of an evaluation."""

from __future__ import annotations

import csv
from pathlib import Path

from rich.table import Table


def result_tables(evaluation: Path) -> list[Table]:
    """Tables of the error per channel and of the gaits; none where the evaluation has no such file."""
    found = (csv_table(evaluation / name, title) for name, title in (("mse.csv", "Error (m^2)"), ("gait.csv", "Gait")))
    return [table for table in found if table is not None]


def csv_table(path: Path, title: str) -> Table | None:
    """A CSV file as a table, numbers to three digits; turned on its side when it is wider than long."""
    if not path.is_file():
        return None
    with path.open(newline="") as file:
        rows = [[short(cell) for cell in row] for row in csv.reader(file)]
    if not rows:
        return None
    if len(rows[0]) > len(rows):
        rows = [list(column) for column in zip(*rows, strict=True)]
    table = Table(title=title, title_justify="left")
    for index, name in enumerate(rows[0]):
        table.add_column(name, justify="left" if index == 0 else "right")
    for row in rows[1:]:
        table.add_row(*row)
    return table


def short(cell: str) -> str:
    """A number to three significant digits; other text as it is."""
    try:
        return f"{float(cell):.3g}"
    except ValueError:
        return cell
