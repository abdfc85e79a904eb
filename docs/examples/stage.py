"""A stage of your own: a function of configuration, finished artifacts, an empty directory and a log, and a record.

With RECORD in STAGES of romgrl/provenance/stage_graph.py and its name in romgrl/config/schema.py it is a value of
`stage=`, and jobs make it; here the function is called by hand, with what RECORD says that it reads.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from romgrl.artifacts import load_arrays
from romgrl.cli.compose import compose_config
from romgrl.config.schema import Config
from romgrl.pipeline.run import run as run_job
from romgrl.provenance.stage_graph import Stage
from romgrl.runtime.stage_log import SilentLog, StageLog


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write heights.csv: how high the body is over the reference, as quantiles in m."""
    heights = load_arrays(inputs["reference"] / "reference.npz")["features"][:, 0]
    rows = [f"{share},{np.quantile(heights, share):.4f}" for share in (0.0, 0.5, 1.0)]
    (output / "heights.csv").write_text("\n".join(["quantile,height_m", *rows, ""]), encoding="utf-8")
    log.message(f"the body rises by {np.ptp(heights):.3f} m")


RECORD = Stage("quantiles of the body's height", f"{__name__}:run", upstream=("reference",), depends=("seed",))


def main() -> Path:
    """Let a job make what it reads, from the teacher that ships, and call it with that."""
    outputs = tempfile.mkdtemp()
    config = compose_config("teacher=pretrained", "stage=reference", "tracking=none", f"paths.outputs={outputs}")
    made, output = run_job(config), Path(outputs, "heights")
    output.mkdir()
    run(config, {name: made[name] for name in RECORD.upstream}, output, Printing())
    return output / "heights.csv"


class Printing(SilentLog):
    """Prints what a stage says, and no progress."""

    def message(self, text: str) -> None:
        """Print a line."""
        print(text)


if __name__ == "__main__":
    print(main().read_text(encoding="utf-8"))
