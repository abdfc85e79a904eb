"""Time until what was trained passes its check, for three seeds; what was trained is kept under outputs/benchmarks."""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe
from benchmarks.measure import Options, Result
from benchmarks.rows.commands import ROOT
from benchmarks.setup import configuration
from romgrl.algorithms.sac import load_sac_policy
from romgrl.config.schema import Config
from romgrl.gait.features import gait_from_rollouts
from romgrl.gait.metrics import describe as describe_gait
from romgrl.stages.rollouts.humanoid import roll_out
from romgrl.stages.wiring.humanoid import humanoid_env
from romgrl.stages.wiring.seeds import EVALUATION_SEED

SEEDS = (0, 1, 2)
KEPT = ROOT / "outputs" / "benchmarks"
EPISODES, SECONDS, TOLERANCE = 16, 10.0, 0.2  # the check: all episodes upright, mean speed within m/s
POLL = 1.0  # s between looks at the checkpoint
CHECKPOINTS = 15.0  # s between checkpoints
STAGE = (
    "import sys, romgrl.stages.student as student; student.CHECKPOINT_SECONDS = float(sys.argv.pop(1));"
    "from romgrl.__main__ import main; main()"
)


def outputs(options: Options, name: str) -> Path:
    """Where trainings of this revision go; a second call goes on with what is there."""
    return KEPT / str(describe()["revision"]) / f"{name}-{'quick' if options.quick else 'full'}-{options.threads}"


def settings(options: Options, directory: Path, seed: int) -> list[str]:
    """Overrides of one training."""
    small = ["experiment=smoke"] if options.quick else []
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
    """Training time until the first checkpoint that passes: 16 of 16 upright, steady speed within 0.2 m/s."""
    found = [student_seed(options, seed) for seed in SEEDS]
    times = [each["passed, min"] if each["passed, min"] is not None else float("inf") for each in found]
    notes = {"seeds": list(SEEDS), "threads": options.threads}
    notes |= {name: [each[name] for each in found] for name in found[0]}
    return median_of(times, "min", "<= 8", notes)


def student_seed(options: Options, seed: int) -> dict[str, Any]:
    """Train one student and keep its checkpoints, or read what an earlier call has found."""
    directory = outputs(options, "student") / str(seed)
    answer = directory / "found.json"
    if answer.exists():
        return dict(json.loads(answer.read_text(encoding="utf-8")))
    overrides = settings(options, directory, seed)
    if run_stage("reference", overrides):
        raise RuntimeError(f"no reference for seed {seed}")
    checkpoints = watch_training(directory, overrides)
    config = configuration(*overrides, threads=options.threads)
    errors = [(t, speed_errors(config, path)) for t, path in checkpoints]
    first, whole = (next((t for t, e in errors if e and e[which] <= TOLERANCE), None) for which in (0, 1))
    _, made = manifest(directory, "student")
    total = float(made["wall_time"])
    share = (first or total) / total
    steps = config.student.total_steps * share
    updates = (config.student.total_steps - config.student.learning_starts) * config.student.updates_per_step * share
    found = {
        "passed, min": None if first is None else round(first / 60, 2),
        "trained, min": round(total / 60, 2),
        "passed with the start counted, min": None if whole is None else round(whole / 60, 2),
        "last one passes": bool(errors[-1][1] and errors[-1][1][0] <= TOLERANCE),
        "env steps, about": round(steps),
        "updates, about": round(updates),
        "teacher before, min": round(float(manifest(directory, "teacher")[1]["wall_time"]) / 60, 2),
    }
    answer.write_text(json.dumps(found), encoding="utf-8")
    return found


def watch_training(directory: Path, overrides: list[str]) -> list[tuple[float, Path]]:
    """Run the student stage and copy each checkpoint it writes; (seconds since the stage began, file), in order."""
    stages = directory / "artifacts" / "student"
    for old in stages.glob("*"):
        shutil.rmtree(old, ignore_errors=True)
    kept = directory / "checkpoints"
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    found: list[tuple[float, Path]] = []
    began, seen = 0.0, 0.0
    command = [sys.executable, "-c", STAGE, str(CHECKPOINTS), "stage=student", *overrides]
    with subprocess.Popen(command, cwd=ROOT, stdout=sys.stderr) as process:
        while process.poll() is None:
            time.sleep(POLL)
            for partial in stages.glob("*.partial"):
                began = began or time.time()
                policy = partial / "policy.safetensors"
                if policy.exists() and policy.stat().st_mtime > seen:
                    seen = policy.stat().st_mtime
                    found.append((seen - began, Path(shutil.copy(policy, kept / f"{seen - began:07.1f}.safetensors"))))
    if process.returncode:
        raise RuntimeError(f"the student stage failed with exit code {process.returncode}")
    path, made = manifest(directory, "student")
    return [*found, (float(made["wall_time"]), path / "policy.safetensors")]


def speed_errors(config: Config, policy: Path) -> tuple[float, float] | None:
    """Errors of the steady speed and of the speed from the reset on, m/s, in ten seconds; None after any fall."""
    steps = round(SECONDS * config.humanoid.control_frequency)
    env = humanoid_env(config, num_envs=EPISODES, episode_steps=steps + 1)
    seed = config.seed + EVALUATION_SEED  # resets that no training has drawn
    rolled = roll_out(env, load_sac_policy(policy), steps=steps, seed=seed, progress=lambda step: None)
    env.close()
    arrays: dict[str, Any] = {
        "dt": np.float64(env.control_step),
        **{f"student_{name}": value for name, value in rolled.items()},
    }
    row = describe_gait(gait_from_rollouts(arrays, "student"), target_speed=config.speed)
    if row["falls"]:
        return None
    return abs(row["steady_speed_m_per_s"] - config.speed), abs(row["mean_speed_m_per_s"] - config.speed)
