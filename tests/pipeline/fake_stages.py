"""Stages that take milliseconds; each writes down that it ran, so that tests can count trainings."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from romgrl import keys
from romgrl.artifacts import save_arrays
from romgrl.config import Config
from romgrl.errors import DivergenceError
from romgrl.progress import StageLog


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write an array, a curve and, for the evaluation, its tables."""
    stage = output.parent.name
    with (output.parents[1] / "calls.txt").open("a") as calls:
        calls.write(f"{stage} {config.speed} {config.eta} {config.seed}\n")
    fault = os.environ.get("FAKE_FAULT", "")
    if fault.startswith(f"{stage}:"):
        save_arrays(output / "half.npz", {"x": np.ones(1)})
        raise KeyboardInterrupt if fault.endswith("interrupt") else DivergenceError(f"{stage}: loss = nan at step 7")
    time.sleep(float(os.environ.get("FAKE_SECONDS", "0")))
    for step in range(3):
        log.progress(step, 3, loss=1.0)
        log.metrics({"loss": float(step)}, step * 10)
    save_arrays(output / "data.npz", {"x": np.arange(4.0), "upstream": np.array(sorted(inputs))})
    if stage == "evaluation":
        (output / "mse.csv").write_text("channel,alignment,baseline,student,reduction_percent\naverage,raw,2,1,50\n")


def install() -> None:
    """Put the fake in the place of every stage."""
    for name, stage in keys.STAGES.items():
        keys.STAGES[name] = keys.Stage("tests.pipeline.fake_stages:run", stage.upstream, stage.depends)


def main() -> None:
    """The command line of romgrl with fake stages."""
    from romgrl.__main__ import main as romgrl

    install()
    romgrl()


if __name__ == "__main__":
    main()
