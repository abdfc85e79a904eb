"""The tables of the page as rows of text, for its template."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from romgrl.artifacts import Manifest
from romgrl.gait import human_bands
from romgrl.gait.features import ALIGNMENTS
from romgrl.gait.measures import MEASURES
from romgrl.report.numbers import fixed, measured
from romgrl.report.style import CHANNEL_LABELS
from romgrl.report.tables import ERROR_DECIMALS


@dataclass(frozen=True)
class Value:
    """A number as text, and whether it lies in the human band; None where there is no band for it."""

    text: str
    human: bool | None


@dataclass(frozen=True)
class GaitRow:
    """One number of the gait: a value per walker, the human band and who measured it."""

    label: str
    values: list[Value]
    band: str
    source: str


def gait_rows(gaits: pd.DataFrame, speed: float) -> list[GaitRow]:
    """gait.csv with the human bands at `speed` m/s beside it."""
    bands = human_bands.bands(speed)
    rows = [{str(key): value for key, value in row.items()} for row in gaits.to_dict("records")]
    columns = [str(name) for name in gaits.columns if name != "walker"]
    columns.insert(columns.index("stride_frequency_hz") + 1, "stride_length_m")
    numbers = [{**row, "stride_length_m": human_bands.stride_length(row)} for row in rows]
    held = [human_bands.bands_for(row, speed) for row in numbers]
    found = []
    for name in columns:
        band = bands.get(name)
        said = [
            Value(measured(name, value), None if math.isnan(value) or name not in own else own[name].holds(value))
            for own, value in zip(held, (float(row[name]) for row in numbers), strict=True)
        ]
        text = " to ".join(measured(name, limit) for limit in (band.low, band.high)) if band else ""
        found.append(GaitRow(MEASURES[name].title, said, text, band.source if band else ""))
    return found


def error_rows(table: pd.DataFrame) -> dict[str, list[list[str]]]:
    """Channel, baseline, student, reduction, teacher's floor, by what they were laid over; numbers with intervals."""
    found: dict[str, list[list[str]]] = {}
    for row in table.to_dict("records"):
        cells = [
            CHANNEL_LABELS.get(row["channel"], row["channel"]),
            _with_interval(row, "baseline", ERROR_DECIMALS),
            _with_interval(row, "student", ERROR_DECIMALS),
            _with_interval(row, "reduction_percent", 1),
            fixed(float(row["teacher_floor"]), ERROR_DECIMALS),
        ]
        found.setdefault(ALIGNMENTS[row["alignment"]], []).append(cells)
    return found


def origin_rows(manifests: Mapping[str, Manifest]) -> list[dict[str, str]]:
    """One row per artifact that the page was made from."""
    return [
        {
            "stage": stage,
            "key": made.key,
            "digest": made.digest,
            "seed": str(made.seed),
            "revision": (made.revision or "unknown") + (" with changes" if made.dirty else ""),
            "time": duration(made.wall_time),
        }
        for stage, made in manifests.items()
    ]


def setting_rows(manifests: Mapping[str, Manifest]) -> list[tuple[str, str, str]]:
    """Every key that decided something, its value, and the stages that it decided."""
    found: dict[tuple[str, str], list[str]] = {}
    for stage, made in manifests.items():
        for key, value in made.config.items():
            found.setdefault((key, "null" if value is None else str(value)), []).append(stage)
    return [(key, value, ", ".join(stages)) for (key, value), stages in sorted(found.items())]


def version_rows(manifests: Mapping[str, Manifest]) -> dict[str, str]:
    """Versions by library; all of them where stages were made with different ones."""
    found: dict[str, set[str]] = {}
    for made in manifests.values():
        for library, version in made.versions.items():
            found.setdefault(library, set()).add(version)
    return {library: ", ".join(sorted(several)) for library, several in sorted(found.items())}


def duration(seconds: float) -> str:
    """Seconds below two minutes, else minutes."""
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def _with_interval(row: Mapping[Any, Any], name: str, decimals: int) -> str:
    value, low, high = (float(row[key]) for key in (name, f"{name}_low", f"{name}_high"))
    interval = f" ({fixed(low, decimals)} to {fixed(high, decimals)})" if math.isfinite(low) else ""
    return fixed(value, decimals) + interval
