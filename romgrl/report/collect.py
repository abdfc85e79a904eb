"""Results of several runs as one Markdown table: python -m romgrl.report.collect OUTPUTS [FILE].

With FILE, the table replaces what stands between the markers `<!-- results -->` and `<!-- end of results -->` in it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from romgrl.artifacts import Manifest, open_artifact
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS
from romgrl.report.style import CHANNEL_LABELS
from romgrl.report.tables import markdown

START, END = "<!-- results -->", "<!-- end of results -->"
SPEED, LEAN, STRIDES = "steady_speed_m_per_s", "trunk_lean_deg", "stride_frequency_hz"


Numbers = dict[str, float]


def evaluations(outputs: Path) -> Iterator[tuple[Manifest, Numbers, dict[str, Numbers]]]:
    """Every verified evaluation under `outputs`, by speed and seed: manifest, reductions, gait of each walker."""
    found = [(open_artifact(path.parent), path.parent) for path in outputs.glob("artifacts/evaluation/*/manifest.json")]
    if not found:
        raise ArtifactError(f"{outputs}: holds no finished evaluation")
    for manifest, directory in sorted(found, key=lambda each: (each[0].config["speed"], each[0].seed)):
        errors = pd.read_csv(directory / "mse.csv")
        names = errors["alignment"] + " " + errors["channel"]
        reductions = dict(zip(names, errors["reduction_percent"].astype(float), strict=True))
        gaits = pd.read_csv(directory / "gait.csv").set_index("walker").astype(float).T
        yield manifest, reductions, {str(walker): dict(gaits[walker]) for walker in gaits}


def results_table(outputs: Path) -> pd.DataFrame:
    """One row per measure, one column per run, and the mean and standard deviation over the runs."""
    columns: dict[str, list[float]] = {}
    rows: Numbers = {}
    for manifest, reductions, gaits in evaluations(outputs):
        rows = {}
        for walker in ("student", "baseline"):
            gait = gaits[walker]
            rows[f"{walker}: episodes upright to the end [%]"] = 100 * (1 - gait["falls"] / gait["episodes"])
            rows[f"{walker}: speed after 2 s [m/s]"] = gait[SPEED]
            rows[f"{walker}: trunk lean, forward positive [deg]"] = gait[LEAN]
            rows[f"{walker}: strides [Hz]"] = gait[STRIDES]
        rows["teacher: strides [Hz]"] = gaits["teacher"][STRIDES]
        for channel in (*CHANNELS, "average"):
            label = CHANNEL_LABELS.get(channel, channel)
            rows[f"aligned error, {label}: reduction [%]"] = reductions[f"aligned {channel}"]
        rows["raw error, average: reduction [%]"] = reductions["raw average"]
        columns[f"{manifest.config['speed']:g} m/s, seed {manifest.seed}"] = list(rows.values())
    table = pd.DataFrame(columns, index=list(rows))
    summary = pd.DataFrame({"mean": table.mean(axis=1), "deviation": table.std(axis=1)})
    return table.join(summary).rename_axis("measure").reset_index()


def main(arguments: Sequence[str]) -> None:
    """Print the table, or write it into a document."""
    if len(arguments) not in (1, 2):
        sys.exit(__doc__)
    text = markdown(results_table(Path(arguments[0])))
    if len(arguments) == 1:
        print(text)
        return
    document = Path(arguments[1])
    before, _, rest = document.read_text().partition(START)
    if END not in rest:
        sys.exit(f"{document}: has no markers {START} and {END}")
    document.write_text(f"{before}{START}\n\n{text}\n{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    main(sys.argv[1:])
