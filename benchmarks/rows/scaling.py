"""How costs grow: series for the plots of docs/images, one row each."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.measure import Options, Result
from benchmarks.rows import humanoid, rom, teacher
from benchmarks.setup import PLAIN_SAC, Student, configuration, in_student_stage
from romgrl.config.teachers import ppo_keys
from romgrl.humanoid.vector_env import PlanarHumanoidVectorEnv

COUNTS = (1, 4, 16, 64, 256, 1024, 4096)
BATCHES, WIDTHS = (64, 256, 1024, 4096), (128, 256, 512)
TEACHER_STEPS, STUDENT_STEPS = 65_536, 3_000

Series = list[dict[str, float]]


def per_second(work: Callable[[], object], each: int, at_least: float) -> float:
    """Median rate of three tries of at least so many seconds, after one call."""
    work()
    rates = []
    for _ in range(3):
        start, rounds = time.perf_counter(), 0
        while (spent := time.perf_counter() - start) < at_least or not rounds:
            work()
            rounds += 1
        rates.append(rounds * each / spent)
    return statistics.median(rates)


def best(series: Series, unit: str, x: str, **notes: Any) -> Result:
    """The highest rate of a series, and the series."""
    top = max(series, key=lambda point: point["y"])
    return Result(top["y"], unit, settings={f"best at {x}": top["x"], **notes, "series": series}).rounded()


def rom_worlds(options: Options) -> Result:
    """Steps per second of the default engine through Python."""
    counts = COUNTS[:4] if options.quick else COUNTS
    series: Series = []
    for count in counts:
        env = rom.make(options.threads, count, **rom.default_engine(options.threads))
        series.append({"x": count, "y": per_second(rom.through_python(env, 10), 10 * count, 0.3)})
    return best(series, "control steps/s", "worlds", threads=options.threads)


def humanoids(options: Options) -> Result:
    """Steps per second of the vector environment."""
    counts = COUNTS[:4] if options.quick else COUNTS
    series: Series = []
    for count in counts:
        env = PlanarHumanoidVectorEnv(num_envs=count, num_threads=options.threads)
        env.reset(seed=0)
        chosen = humanoid.actions(1, count)[0]
        series.append({"x": count, "y": per_second(partial(env.step, chosen), count, 0.3)})
    return best(series, "control steps/s", "humanoids", threads=options.threads)


def updates(options: Options) -> Result:
    """Updates per second of plain SAC for batches and widths."""
    series: Series = []
    for width in WIDTHS[:1] if options.quick else WIDTHS:
        for batch in BATCHES[:2] if options.quick else BATCHES:
            sizes = (f"student.hidden_sizes=[{width},{width}]", f"student.batch_size={batch}")

            def measure(student: Student) -> float:
                student.fill()
                return per_second(student.updates(4), 4, 0.3)

            y = in_student_stage(measure, configuration(*PLAIN_SAC, *sizes, threads=options.threads))
            series.append({"x": batch, "width": width, "y": y})
    return best(series, "updates/s", "batch", observation=358, action=21, threads=options.threads, ours="student=sac")


def threads(options: Options) -> Result:
    """Seconds of short teacher and student stages for one thread to all cores."""
    series: Series = []
    counts = sorted({1, 2, *(2**power for power in range(2, 8) if 2**power <= (os.cpu_count() or 1))})
    for count in counts:
        config = configuration(f"teacher.total_steps={options.scaled(TEACHER_STEPS)}", threads=count)
        took = statistics.median(ppo_keys(config.teacher).total_steps / teacher.training_rate(config) for _ in range(3))
        steps = options.scaled(STUDENT_STEPS)

        def measure(student: Student, steps: int = steps) -> float:
            student.fill()
            return 1 / per_second(partial(student.train, learning_starts=0, total_steps=steps), 1, 0.0)

        student_config = configuration("discriminator=none", "eta=1", threads=count)
        series.append({"x": count, "teacher": took, "student": in_student_stage(measure, student_config)})
    last = series[-1]
    notes = {"teacher steps": TEACHER_STEPS, "student steps": STUDENT_STEPS, "ours": "student without discriminator"}
    speedup = series[0]["student"] / last["student"]
    return Result(
        speedup, "x", settings={"value": f"student, {last['x']} threads beside 1", **notes, "series": series}
    ).rounded()
