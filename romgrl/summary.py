"""The results of an evaluation as the tables that end a run, and as numbers that runs are compared by."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from rich.table import Table


def result_tables(evaluation: Path) -> list[Table]:
    """Tables of the error per channel and of the gaits; none where the evaluation has no such file."""
    found = (csv_table(evaluation / name, title) for name, title in (("mse.csv", "Error (m^2)"), ("gait.csv", "Gait")))
    return [table for table in found if table is not None]


def result_metrics(evaluation: Path) -> dict[str, float]:
    """Every finite number of both files, named after the text in its row and its column: student/mean_speed_m_per_s."""
    metrics: dict[str, float] = {}
    for path in (evaluation / "mse.csv", evaluation / "gait.csv"):
        for row in csv.DictReader(path.read_text().splitlines()) if path.is_file() else ():
            numbers = {column: number(cell) for column, cell in row.items()}
            name = "/".join(cell for column, cell in row.items() if numbers[column] is None and cell)
            metrics |= {f"{name}/{column}": value for column, value in numbers.items() if value is not None}
    return {name: value for name, value in metrics.items() if math.isfinite(value)}


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
    value = number(cell)
    return cell if value is None else f"{value:.3g}"


def number(cell: str) -> float | None:
    """The number in a cell, None for text."""
    try:
        return float(cell)
    except ValueError:
        return None
