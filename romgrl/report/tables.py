"""Tables as Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pandas as pd

from romgrl.report.style import CHANNEL_LABELS

UNITS = {
    "m_per_s": "m/s",
    "percent": "%",
    "hz": "Hz",
    "m": "m",
    "s": "s",
    "deg": "deg",
    "strides": "strides",
}


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown; text to the left, numbers to four significant digits to the right."""
    numeric = [pd.api.types.is_numeric_dtype(table[column]) for column in table]
    lines = [
        "| " + " | ".join(str(column) for column in table) + " |",
        "|" + "|".join("---:" if right else "---" for right in numeric) + "|",
    ]
    lines += ["| " + " | ".join(cell(value) for value in row) + " |" for row in table.itertuples(index=False)]
    return "\n".join(lines) + "\n"


def cell(value: object) -> str:
    """A number to four significant digits, a dash for what is not known, text as it is."""
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "-"
    return str(value).replace("|", "\\|")


def error_table(errors: pd.DataFrame) -> pd.DataFrame:
    """mse.csv for reading: aligned beside raw, channels by name, one row each."""
    table = pd.DataFrame({"channel": [*CHANNEL_LABELS.values(), "average"]})
    for alignment in ("aligned", "raw"):
        rows = errors[errors.alignment == alignment].set_index("channel").loc[[*CHANNEL_LABELS, "average"]]
        for column, label in (("baseline", "baseline"), ("student", "student"), ("teacher_floor", "teacher floor")):
            table[f"{label}, {alignment} [m²]"] = rows[column].to_numpy(float)
        table[f"reduction, {alignment} [%]"] = rows["reduction_percent"].to_numpy(float).round(1)
    return table


def distance_table(distances: pd.DataFrame) -> pd.DataFrame:
    """distances.csv for reading: one row per distance and channel, the unit beside it, p where there is one."""
    names = {**CHANNEL_LABELS, "all": "all channels"}
    table = pd.DataFrame({"distance": distances.distance, "channel": distances.channel.map(names)})
    for column in ("baseline", "student", "teacher_floor"):
        table[column.replace("_", " ")] = distances[column].astype(float)
    table["unit"] = distances.unit.astype(str)
    for column in ("baseline_p", "student_p", "floor_p"):
        table[column.replace("_", " ")] = distances[column].astype(float)
    return table


def gait_table(gaits: pd.DataFrame) -> pd.DataFrame:
    """gait.csv for reading: one row per number, one column per walker, units in brackets."""
    table = gaits.set_index("walker").T
    table.insert(0, "", [with_unit(str(name)) for name in table.index])
    return table.reset_index(drop=True).rename_axis(None, axis=1)


def with_unit(column: str) -> str:
    """`mean_speed_m_per_s` as `mean speed [m/s]`."""
    for suffix, unit in UNITS.items():
        if column.endswith(f"_{suffix}"):
            return f"{column.removesuffix(f'_{suffix}').replace('_', ' ')} [{unit}]"
    return column.replace("_", " ")


def definitions(rows: Mapping[str, str]) -> str:
    """A two-column table of names and what they mean."""
    return markdown(pd.DataFrame({"number": list(rows), "how it is obtained": list(rows.values())}))
