"""The README's table: the runs of the paper's sweep side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.report.style import CHANNEL_LABELS
from romgrl.report.tables import markdown
from romgrl.results.cells import JobResult, results
from romgrl.results.document import PAPER, merged
from romgrl.results.sweeps import sweeps

START, END = "<!-- results -->", "<!-- end of results -->"
GAIT = {
    "falls_percent": "episodes with a fall [%]",
    "steady_speed_m_per_s": "speed after 2 s [m/s]",
    "trunk_lean_deg": "trunk lean, forward positive [deg]",
    "stride_frequency_hz": "strides [Hz]",
}
ROWS = {
    **{f"{walker}/{name}": f"{walker}: {label}" for walker in ("student", "baseline") for name, label in GAIT.items()},
    "teacher/stride_frequency_hz": "teacher: strides [Hz]",
    **{
        f"{channel}/aligned/reduction_percent": f"aligned error, {CHANNEL_LABELS.get(channel, channel)}: reduction [%]"
        for channel in (*CHANNELS, "average")
    },
    "average/raw/reduction_percent": "raw error, average: reduction [%]",
}


def write_readme(outputs: Path, document: Path) -> None:
    """Put the table between the markers. Raises ArtifactError where there is no such sweep, or no such place."""
    found = [sweep for sweep in merged(sweeps(outputs)) if sweep.name == PAPER]
    jobs = [each for sweep in found for each in results(sweep, outputs) if each.evaluation is not None]
    if not jobs:
        raise ArtifactError(f"{outputs}: no job of the sweep {PAPER} has finished")
    before, _, rest = document.read_text().partition(START)
    if END not in rest:
        raise ArtifactError(f"{document}: has no markers {START} and {END}")
    document.write_text(f"{before}{START}\n\n{markdown(runs_table(jobs))}\n{END}{rest.partition(END)[2]}")


def runs_table(jobs: Sequence[JobResult]) -> pd.DataFrame:
    """One row per number, one column per run, and mean and deviation over the runs of a speed."""
    by_speed: dict[float, list[JobResult]] = {}
    for each in jobs:
        assert each.evaluation is not None
        by_speed.setdefault(float(each.evaluation.settings["speed"]), []).append(each)
    parts: dict[str, Any] = {}
    for speed, several in sorted(by_speed.items(), reverse=True):
        runs = {}
        for each in sorted(several, key=lambda job: job.evaluation.manifest.seed if job.evaluation else 0):
            assert each.evaluation is not None
            short = ", short budget" if each.short else ""
            runs[f"{speed:g} m/s, seed {each.evaluation.manifest.seed}{short}"] = [
                each.numbers.get(name) for name in ROWS
            ]
        table = pd.DataFrame(runs, index=list(ROWS.values()), dtype=float)
        parts |= {str(name): table[name] for name in table}
        if len(runs) > 1:
            parts |= {f"{speed:g} m/s, mean": table.mean(axis=1), f"{speed:g} m/s, deviation": table.std(axis=1)}
    return pd.DataFrame(parts).rename_axis("measure").reset_index()
