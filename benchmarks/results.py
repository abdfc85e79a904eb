"""results.json and the table in docs/benchmarks.md."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from romgrl.report.markdown_table import markdown_table

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.json"
DOCUMENT = HERE.parent / "docs" / "benchmarks.md"
START, END = "<!-- results: written by make bench -->", "<!-- end of results -->"

Row = dict[str, Any]


def load(path: Path = RESULTS) -> list[Row]:
    """Rows of earlier runs; none where there is no file."""
    rows: list[Row] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return rows


def merge(old: Sequence[Row], new: Sequence[Row], order: Sequence[str]) -> list[Row]:
    """New rows replace old ones of the same name; rows that are no longer known go, the rest stay as they were."""
    rows = {row["name"]: row for row in (*old, *new)}
    return [rows[name] for name in order if name in rows]


def write(rows: Sequence[Row], path: Path = RESULTS) -> None:
    """One row a paragraph, so that a difference of two files reads well."""
    path.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def number(value: float | None, unit: str = "") -> str:
    """Three significant digits, thousands with commas."""
    if value is None:
        return ""
    text = f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
    return f"{text} {unit}".strip()


def table(rows: Iterable[Row], titles: Mapping[str, str]) -> str:
    """Markdown table; a row that was not measured says why."""
    lines = []
    for row in rows:
        title = f"{titles.get(row['name'], '')} (`{row['name']}`)"
        if row["status"] != "measured":
            lines.append((title, f"{row['status']}: {row['reason']}", "", "", "", ""))
            continue
        mark = {True: "reached", False: "**missed**", None: ""}[row["reached"]]
        cells = (number(row["value"], row["unit"]), number(row["reference"]), number(row["ratio"]), row["target"] or "")
        lines.append((title, *cells, mark))
    columns = ("row", "measured", "compared with", "ratio", "to reach", "")
    return markdown_table(columns, lines).rstrip("\n")


def details(rows: Iterable[Row]) -> str:
    """Settings of both sides, row by row, and when and on what each was measured."""
    lines = []
    for row in rows:
        if row["status"] == "measured":
            kept = {name: value for name, value in row["settings"].items() if name != "series"}
            settings = "; ".join(f"{name} {plain(value)}" for name, value in kept.items())
            stamp = ", ".join((row["time"], row["machine"]["revision"], *own_rate(row)))
            lines.append(f"- `{row['name']}` ({stamp}): {settings}")
    return "\n".join(lines)


def own_rate(row: Row) -> list[str]:
    """The machine's rate of matrix products when a row was measured; none of rows from before there was one."""
    return [f"sgemm {rate:g} GFLOP/s on {threads} thread(s)" for threads, rate in row.get("sgemm", {}).items()]


def plain(value: Any) -> str:
    """A setting without JSON's quotes and braces."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {plain(part)}" for name, part in value.items())
    return "[" + ", ".join(map(plain, value)) + "]" if isinstance(value, list | tuple) else str(value)


def machines(rows: Iterable[Row]) -> str:
    """The machines that the rows were measured on, newest versions last, each once."""
    lines = []
    for row in rows:
        machine = row["machine"]
        versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
        line = f"{machine['processor']}, {machine['cores']} cores, {machine['system']}; {versions}"
        if line not in lines:
            lines.append(line)
    return "\n".join(f"Machine: {line}.\n" for line in lines)


def document(text: str, rows: Sequence[Row], titles: Mapping[str, str]) -> str:
    """The page with a new table between its markers; ValueError if it has none."""
    before, start, rest = text.partition(START)
    _, end, after = rest.partition(END)
    if not (start and end):
        raise ValueError(f"the page lacks the markers {START!r} and {END!r}")
    body = "\n".join((machines(rows), table(rows, titles), "\nSettings, by row:\n", details(rows)))
    return f"{before}{START}\n\n{body}\n\n{END}{after}"


def publish(rows: Sequence[Row], titles: Mapping[str, str]) -> None:
    """Write the rows and the page."""
    write(rows)
    DOCUMENT.write_text(document(DOCUMENT.read_text(encoding="utf-8"), rows, titles), encoding="utf-8")
