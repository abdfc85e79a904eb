"""Stages that take milliseconds; each writes down that it ran, so that tests can count trainings."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from safetensors.numpy import save

from romgrl.artifacts import save_arrays, write_bytes
from romgrl.config.schema import Config
from romgrl.errors import DivergenceError
from romgrl.pipeline import worker
from romgrl.provenance import stage_graph
from romgrl.runtime.stage_log import StageLog
from tests.helpers.limits import wait_until

FELL = "perturbation,unit,level,walker,trials,fall_rate\n"
FELL += "".join(f"push_forward,N s/kg,0.3,{walker},3,{rate}\n" for walker, rate in (("student", 0), ("baseline", 1)))
ROBUSTNESS = {"robustness.csv": FELL, "floquet.csv": "rank,modulus,low,high\n1,0.5,0.4,0.6\n"}


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Write an array, a curve and, for the evaluation, its tables."""
    torch = sys.modules.get("torch")
    stage = output.parent.name
    start = time.time()
    fault = os.environ.get("FAKE_FAULT", "")
    try:  # before the note, as a test may interrupt as soon as it is there
        note(output, "calls.txt", stage, config.speed, config.eta, config.seed)
        if not fault.startswith(f"{stage}:"):
            log.progress(0, 3, loss=1.0)
            sleep(float(os.environ.get("FAKE_SECONDS", "0")))
    except KeyboardInterrupt:
        save_arrays(output / "half.npz", {"x": np.ones(1)})
        raise
    if fault.startswith(f"{stage}:"):
        save_arrays(output / "half.npz", {"x": np.ones(1)})
        wait_for(output.parents[1] / "calls.txt", int(os.environ.get("FAKE_FAULT_CALLS", "1")))
        raise KeyboardInterrupt if fault.endswith("interrupt") else DivergenceError(f"{stage}: loss = nan at step 7")
    for step in range(3):
        log.progress(step, 3, loss=1.0)
        log.metrics({"loss": float(step)}, step * 10)
    given = torch.get_num_threads() if hasattr(torch, "get_num_threads") else "none"  # its stand-in has no threads
    note(output, "times.txt", stage, start, time.time(), os.getpid(), config.threads, given)
    numbers = np.array([config.speed, config.eta, config.seed, config.teacher.speed])
    save_arrays(output / "data.npz", {"x": np.arange(4.0), "numbers": numbers, "upstream": np.array(sorted(inputs))})
    write_bytes(output / "policy.safetensors", save({"w": np.ones((2, 3), np.float32)}))
    for name, text in ROBUSTNESS.items() if stage == "robustness" else ():
        (output / name).write_text(text, encoding="utf-8")
    if stage == "evaluation":
        (output / "mse.csv").write_text(
            "channel,alignment,baseline,student,reduction_percent\naverage,raw,2,1,50\n", encoding="utf-8"
        )


def note(output: Path, file: str, *words: object) -> None:
    """Add a line to a file beside all artifacts."""
    with (output.parents[1] / file).open("a", encoding="utf-8") as lines:
        lines.write(" ".join(str(word) for word in words) + "\n")


def sleep(seconds: float) -> None:
    """As a training, which is back in Python all the time: a signal may come to another thread and end no long call."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        time.sleep(min(left, 0.05))


def wait_for(path: Path, lines: int) -> None:
    """Wait until a file has so many lines."""
    wait_until(lambda: path.exists() and len(path.read_text(encoding="utf-8").splitlines()) >= lines)


def install() -> None:
    """Put the fake in the place of every stage."""
    for name, stage in stage_graph.STAGES.items():
        stage_graph.STAGES[name] = replace(stage, function="tests.helpers.fake_stages:run")


def do_without_torch() -> None:
    """Import no torch in this process, which takes seconds: a fake stage draws nothing."""
    worker.prepare = lambda config: None


def main() -> None:
    """The command line of romgrl with fake stages."""
    from romgrl.__main__ import main as romgrl

    install()
    if os.environ.get("FAKE_TORCH") != "real":
        do_without_torch()
    romgrl()


if __name__ == "__main__":
    main()
