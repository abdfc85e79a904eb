"""The walkers side by side, over seeds: what null models score, and how each of them walks beside human adults."""

from __future__ import annotations

from collections.abc import Sequence

from romgrl.gait.human_bands import bands
from romgrl.gait.measures import MEASURES, SWEPT
from romgrl.gait.null_models import SCORED
from romgrl.report.numbers import significant
from romgrl.report.tables import NULL_LABELS, null_rows
from romgrl.results.claims import column
from romgrl.results.evaluation_index import TOUCHDOWNS, FinishedEvaluation
from romgrl.results.statistics import summarize
from romgrl.results.sweep_cells import COMPARED
from romgrl.results.text_table import BRACKETS, Sheet, mean_text

TOUCHDOWN_TITLE = "touchdowns of the feet from half a stride apart [strides]"


def nulls_sheet(evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """One row per number of null_models.csv, one column per walker."""
    rows = [
        (label, *(mean_of(evaluations, f"{measure}/{channel}/{walker}") for walker in SCORED))
        for measure, channel, label, _ in null_rows()
    ]
    title = f"Beside walkers that learned nothing, mean over seeds; {BRACKETS}"
    return Sheet(title, ("", *(NULL_LABELS.get(name, name) for name in SCORED)), rows, ("",), file="null_models")


def gait_sheet(evaluations: Sequence[FinishedEvaluation]) -> Sheet:
    """One row per measure of the gait, the energy and the symmetry, one column per walker; human bands beside them."""
    known = bands(float(evaluations[0].settings["speed"]))
    rows = []
    for name in (*SWEPT, TOUCHDOWNS):
        title = MEASURES[name].title if name in MEASURES else TOUCHDOWN_TITLE
        band = known.get(name)
        human = "-" if band is None else f"{significant(band.low)} to {significant(band.high)}"
        rows.append((title, *(mean_of(evaluations, f"{walker}/{name}") for walker in COMPARED), human))
    return Sheet(f"Gait, mean over seeds; {BRACKETS}", ("", *COMPARED, "human"), rows, ("",), file="gait")


def mean_of(evaluations: Sequence[FinishedEvaluation], name: str) -> str:
    """The mean of a number with its interval or range; a dash where no evaluation has it."""
    return mean_text(summarize(column(evaluations, name)))
