"""Time until what was trained passes its check, for three seeds; what was trained is kept under outputs/benchmarks."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.machine import describe
from benchmarks.measure import Options, Result
from benchmarks.rows.commands import ROOT

SEEDS = (0, 1, 2)
KEPT = ROOT / "outputs" / "benchmarks"


def outputs(options: Options, name: str) -> Path:
    """Where trainings of this revision go; a second call goes on with what is there."""
    return KEPT / str(describe()["revision"]) / f"{name}-{'quick' if options.quick else 'full'}-{options.threads}"


def settings(options: Options, directory: Path, seed: int) -> list[str]:
    """Overrides of one training."""
    small = ["experiment=smoke", "student.check_steps=512"] if options.quick else []
    return [*small, f"seed={seed}", f"threads={options.threads}", f"paths.outputs={directory}", "tracking=none"]


def run_stage(stage: str, overrides: list[str]) -> int:
    """Exit code of one stage with what it needs."""
    command = [sys.executable, "-m", "romgrl", f"stage={stage}", *overrides]
    return subprocess.run(command, cwd=ROOT, stdout=sys.stderr, check=False).returncode


def manifest(directory: Path, stage: str) -> tuple[Path, dict[str, Any]]:
    """The one artifact of a stage and its manifest."""
    (path,) = (directory / "artifacts" / stage).glob("*/manifest.json")
    return path.parent, json.loads(path.read_text(encoding="utf-8"))


def teacher(options: Options) -> Result:
    """Training time of teachers whose reference passes the reference stage's own check of the gait."""
    times, passed = [], []
    for seed in SEEDS:
        directory = outputs(options, "teacher") / str(seed)
        passed.append(run_stage("reference", settings(options, directory, seed)) == 0)
        times.append(float(manifest(directory, "teacher")[1]["wall_time"]))
    counted = [each if good else float("inf") for each, good in zip(times, passed, strict=True)]
    notes = {"seeds": list(SEEDS), "s": [round(t, 1) for t in times], "passed": passed, "threads": options.threads}
    return median_of(counted, "s", "<= 60", notes)


def median_of(times: list[float], unit: str, target: str, notes: dict[str, Any]) -> Result:
    """Median over the seeds; a seed that never passed counts as forever."""
    median = statistics.median(times)
    if median == float("inf"):
        raise RuntimeError(f"fewer than half of the seeds passed: {notes}")
    return Result(median, unit, target=target, settings=notes).rounded()


def student(options: Options) -> Result:
    """Training time until the first check that passes, by the stage's own `checks.csv`."""
    found = [student_seed(options, seed) for seed in SEEDS]
    times = [each["passed, min"] if each["passed, min"] is not None else float("inf") for each in found]
    notes = {"seeds": list(SEEDS), "threads": options.threads}
    notes |= {name: [each[name] for each in found] for name in found[0]}
    return median_of(times, "min", "<= 4", notes)


def student_seed(options: Options, seed: int) -> dict[str, Any]:
    """Train one student, or take the one that an earlier call has trained, and read its checks."""
    directory = outputs(options, "student") / str(seed)
    if run_stage("student", settings(options, directory, seed)):
        raise RuntimeError(f"seed {seed} left no student")
    path, made = manifest(directory, "student")
    checks = pd.read_csv(path / "checks.csv")
    total, last = float(made["wall_time"]) / 60, float(checks["step"].iloc[-1])
    passed = checks.loc[checks["passed"] == 1, "step"]
    first = None if passed.empty else float(passed.iloc[0])
    return {
        "passed, min": None if first is None else round(total * first / last, 2),
        "trained, min": round(total, 2),
        "first step that passes": first,
        "steps": last,
        "checks that pass": f"{len(passed)} of {len(checks)}",
        "teacher before, min": round(float(manifest(directory, "teacher")[1]["wall_time"]) / 60, 2),
    }
