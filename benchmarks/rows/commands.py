"""What a user waits for: help, a run that reuses everything, logging, and the whole from a fresh clone."""

from __future__ import annotations

import io
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.measure import Options, Result, interleave, seconds
from benchmarks.setup import configuration
from romgrl.pipeline import run as pipeline

ROOT = Path(__file__).resolve().parents[2]


def romgrl(*arguments: str, threads: int) -> float:
    """Seconds of one command; RuntimeError with its last line if it fails."""
    command = [sys.executable, "-m", "romgrl", *arguments]
    environment = os.environ | {"OMP_NUM_THREADS": str(threads)}
    start = time.perf_counter()
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, encoding="utf-8"
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)}: {(done.stderr.strip().splitlines() or ['failed'])[-1]}")
    return time.perf_counter() - start


def repeated(options: Options, *arguments: str, target: str, **notes: Any) -> Result:
    """Median wall time of a command, after one that warms the files up."""
    times = interleave({"ours": lambda: romgrl(*arguments, threads=options.threads)}, options.repeats)["ours"]
    spread = {"repeats": options.repeats, "range, s": [round(min(times), 2), round(max(times), 2)]}
    shown = " ".join(text for text in arguments if not text.startswith("paths."))
    value = statistics.median(times)
    return Result(
        value, "s", target=target, settings={"ours": f"python -m romgrl {shown}", **notes, **spread}
    ).rounded()


def help_time(options: Options) -> Result:
    """Time of --help."""
    return repeated(options, "--help", target="<= 1.5")


def reused_run(options: Options) -> Result:
    """Time of a run, tracking included, that finds every stage made."""
    with tempfile.TemporaryDirectory() as directory:
        arguments = ("experiment=smoke", f"paths.outputs={directory}")
        romgrl(*arguments, threads=options.threads)
        return repeated(options, *arguments, target="<= 4", tracking="sqlite", stages="all reused")


def tracking_share(options: Options) -> Result:
    """The default teacher's training time with MLflow and without, in turn; the store is there before.

    A stage of a minute; three alternations instead of seven, as each takes two of them.
    """
    steps, repeats = options.scaled(1_500_000), min(options.repeats, 3)
    seeds = iter(range(10_000))

    with tempfile.TemporaryDirectory() as directory:

        def training(tracking: str) -> float:
            overrides = ("stage=teacher", f"tracking={tracking}", f"paths.outputs={directory}", f"seed={next(seeds)}")
            config = configuration(*overrides, f"teacher.total_steps={steps}", threads=options.threads)
            made = pipeline.run(config, console=Console(file=io.StringIO()))
            return float(json.loads((made["teacher"] / "manifest.json").read_text(encoding="utf-8"))["wall_time"])

        sides = {"on": lambda: training("sqlite"), "off": lambda: training("none")}
        samples = interleave(sides, repeats)
    on, off = (statistics.median(samples[name]) for name in ("on", "off"))
    shares = [a / b for a, b in zip(samples["on"], samples["off"], strict=True)]
    notes = {
        "ours": f"stage=teacher, {steps:,} steps, tracking=sqlite",
        "reference": "tracking=none",
        "threads": options.threads,
        "repeats": repeats,
        "ratio_range": [round(min(shares), 3), round(max(shares), 3)],
    }
    return Result(on, "s", off, on / off, "<= 1.01", notes).rounded()


def fresh_run(options: Options) -> Result:
    """`make run` in a fresh clone, from the virtual environment to the report; pip may use its cache."""
    with tempfile.TemporaryDirectory() as directory:
        clone = Path(directory) / "romgrl"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        arguments = "experiment=smoke" if options.quick else ""
        hidden = ("VIRTUAL_ENV", "VENV", "PYTHONPATH", "OMP_NUM_THREADS", "MAKEFLAGS", "MAKELEVEL", "ARGS")
        environment = {name: value for name, value in os.environ.items() if name not in hidden}

        def make(*targets: str) -> float:
            return seconds(
                lambda: subprocess.run(["make", *targets], cwd=clone, env=environment, check=True, stdout=sys.stderr)
            )

        install = make("install")
        run = make("run", *([f"ARGS={arguments}"] if arguments else []))
        reports = list(clone.glob("outputs/artifacts/report/*/report.html"))
    if not reports:
        raise RuntimeError("make run left no report")
    notes = {"make install, min": round(install / 60, 2), "make run, min": round(run / 60, 2), "cores": os.cpu_count()}
    return Result((install + run) / 60, "min", target="<= 15", settings=notes).rounded()
