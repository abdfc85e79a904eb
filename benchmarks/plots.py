"""Plots of how costs grow, from the series in results.json."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.results import Row


def draw(rows: Sequence[Row]) -> None:
    """Write the plots whose series were measured."""
