"""Tables as Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd

from romgrl.gait.features import ALIGNMENTS, ALL
from romgrl.gait.measures import MEASURES
from romgrl.gait.null_models import AVERAGE, MEAN_ERROR, OVER_VARIANCE, REDUCTIONS
from romgrl.report.markdown_table import markdown_table
from romgrl.report.numbers import fixed, measured, significant
from romgrl.report.style import CHANNEL_LABELS

ERROR_DECIMALS = 5  # m²
DISTANCE_DECIMALS = 4
DISTANCE_LABELS = {
    "mmd": ("MMD²", 4),
    "wasserstein": ("Wasserstein-1 [SD of the teacher]", 3),
    "dtw": ("DTW [SD of the teacher]", 3),
}  # and decimals
NULL_LABELS = {"teacher": "teacher (floor)", "other_teacher": "other teacher", "stretched": "teacher, stretched"}


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
    """mse.csv for reading: one row per channel and what it was laid over, channels by name."""
    table = pd.DataFrame(
        {"laid over": errors.alignment.map(ALIGNMENTS), "channel": errors.channel.replace(CHANNEL_LABELS)}
    )
    for column in ("baseline", "student", "teacher_floor"):
        table[f"{column.replace('_', ' ')} [m²]"] = [fixed(float(value), ERROR_DECIMALS) for value in errors[column]]
    table["reduction [%]"] = [fixed(float(value), 1) for value in errors["reduction_percent"]]
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


def null_models_table(nulls: pd.DataFrame) -> pd.DataFrame:
    """null_models.csv for reading: one row per number, one column per walker; a dash for what is not there."""
    values = nulls.set_index(["walker", "measure", "channel"])["value"]
    walkers = list(dict.fromkeys(nulls.walker))
    rows = [
        [label, *(fixed(float(values.get((walker, measure, channel), float("nan"))), decimals) for walker in walkers)]
        for measure, channel, label, decimals in null_rows()
    ]
    return pd.DataFrame(rows, columns=["", *(NULL_LABELS.get(name, name) for name in walkers)])


def null_rows() -> Iterator[tuple[str, str, str, int]]:
    """Yield measure, channel, label and decimals of each row of the null models' table."""
    yield OVER_VARIANCE, AVERAGE, "error over variance, mean", 2
    for channel, label in CHANNEL_LABELS.items():
        yield OVER_VARIANCE, channel, f"error over variance, {label}", 2
    for alignment, over in ALIGNMENTS.items():
        yield REDUCTIONS[alignment], AVERAGE, f"reduction, {over}: mean of the channels' [%]", 1
        yield REDUCTIONS[alignment], MEAN_ERROR, f"reduction, {over}: of the mean error [%]", 1
    for distance, (label, decimals) in DISTANCE_LABELS.items():
        yield distance, ALL, label, decimals


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
