"""Tables as Markdown."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from romgrl.gait.measures import MEASURES
from romgrl.report.markdown_table import markdown_table
from romgrl.report.numbers import fixed, measured, significant
from romgrl.report.style import CHANNEL_LABELS

ERROR_DECIMALS = 5  # m²
DISTANCE_DECIMALS = 4


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown; text to the left, numbers to the right, to four significant digits unless they are text."""
    numeric = [i for i, column in enumerate(table) if all(is_number(value) for value in table[column])]
    rows = ([cell(value) for value in row] for row in table.itertuples(index=False))
    return markdown_table([str(column) for column in table], rows, right=numeric)


def cell(value: object) -> str:
    """A number to four significant digits, a dash for what is not known, text as it is."""
    if isinstance(value, float):
        return significant(value, 4)
    return str(value)


def is_number(value: object) -> bool:
    """Tell whether a cell is a number, as one or as text; a dash stands for one."""
    try:
        float("nan" if value == "-" else str(value))
    except ValueError:
        return False
    return True


def error_table(errors: pd.DataFrame) -> pd.DataFrame:
    """mse.csv for reading: aligned beside raw, channels by name, one row each."""
    table = pd.DataFrame({"channel": [*CHANNEL_LABELS.values(), "average"]})
    for alignment in ("aligned", "raw"):
        rows = errors[errors.alignment == alignment].set_index("channel").loc[[*CHANNEL_LABELS, "average"]]
        for column, label in (("baseline", "baseline"), ("student", "student"), ("teacher_floor", "teacher floor")):
            table[f"{label}, {alignment} [m²]"] = [fixed(float(value), ERROR_DECIMALS) for value in rows[column]]
        table[f"reduction, {alignment} [%]"] = [fixed(float(value), 1) for value in rows["reduction_percent"]]
    return table


def distance_table(distances: pd.DataFrame) -> pd.DataFrame:
    """distances.csv for reading: one row per distance and channel, the unit beside it, p where there is one."""
    names = {**CHANNEL_LABELS, "all": "all channels"}
    table = pd.DataFrame({"distance": distances.distance, "channel": distances.channel.map(names)})
    for column in ("baseline", "student", "teacher_floor"):
        table[column.replace("_", " ")] = [fixed(float(value), DISTANCE_DECIMALS) for value in distances[column]]
    table["unit"] = distances.unit.astype(str)
    for column in ("baseline_p", "student_p", "floor_p"):
        table[column.replace("_", " ")] = [fixed(float(value), DISTANCE_DECIMALS) for value in distances[column]]
    return table


def gait_table(gaits: pd.DataFrame) -> pd.DataFrame:
    """gait.csv for reading: one row per number, one column per walker, units in brackets."""
    table = gaits.set_index("walker").T.astype(object)
    for name in table.index:
        table.loc[name] = [measured(str(name), float(value)) for value in table.loc[name]]
    table.insert(0, "", [MEASURES[str(name)].title for name in table.index])
    return table.reset_index(drop=True).rename_axis(None, axis=1)


def definitions(rows: Mapping[str, str]) -> str:
    """A two-column table of names and what they mean."""
    return markdown(pd.DataFrame({"number": list(rows), "how it is obtained": list(rows.values())}))
