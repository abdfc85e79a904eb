"""The student stage: overlap of physics and learner, memory, and the GPU."""

from __future__ import annotations

import gc
import itertools
import os
import statistics
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.measure import Options, Result, Unavailable, compare, interleave, rate, seconds
from benchmarks.setup import PLAIN_SAC, Student, configuration, in_student_stage, write_reference

OVERLAP_STEPS = 6_000  # after learning has started
TRANSITIONS = 1_000_000
FLOATS = 358  # numbers of an observation
PAGE = os.sysconf("SC_PAGE_SIZE")


def overlap(options: Options) -> Result:
    """Wall time of the stage's loop beside the longer of its two halves, each alone with the threads it has there."""
    steps = options.scaled(OVERLAP_STEPS)

    def measure(student: Student) -> Result:
        student.fill()
        env, settings = student.env, student.config.student
        recorded: list[NDArray[np.float32]] = []
        real = env.step

        def record(actions: NDArray[np.float32]) -> Any:
            recorded.append(actions.copy())
            return real(actions)

        def stage() -> None:
            recorded.clear()
            with patch.object(env, "step", record):
                student.train(learning_starts=0, total_steps=steps)

        def physics() -> None:
            env.reset(seed=student.config.seed)
            for actions in recorded:
                env.step(actions)

        updates = round(steps * settings.updates_per_step)
        sides = {
            "stage": lambda: seconds(stage),
            "physics": lambda: seconds(physics),
            "learner": lambda: seconds(student.updates(updates)),
        }
        samples = interleave(sides, 1 if options.quick else 3)
        times = {name: statistics.median(values) for name, values in samples.items()}
        limit = max(times["physics"], times["learner"])
        alone = {f"{name} alone, s": round(times[name], 3) for name in ("physics", "learner")}
        shape = {"env steps": steps, "updates": updates, "envs": env.num_envs, "batch": settings.batch_size}
        notes = {"threads": options.threads, **shape, **alone, "ours": "the default student with its discriminator"}
        return Result(times["stage"], "s", limit, times["stage"] / limit, "<= 1.15", notes).rounded()

    with tempfile.TemporaryDirectory() as directory:
        config = configuration("student.check_steps=0", threads=options.threads)
        return in_student_stage(measure, config, write_reference(Path(directory)))


def resident() -> int:
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * PAGE


def memory(options: Options) -> Result:
    """Growth of the process from before the stage until its loop has filled the buffer, beside observations alone."""
    if not Path("/proc/self/statm").exists():
        raise Unavailable("the memory of a process is read from /proc, which this system lacks")
    transitions = options.scaled(TRANSITIONS)
    keys = (f"student.buffer_size={transitions}", f"student.learning_starts={transitions}")
    config = configuration(*PLAIN_SAC, *keys, f"student.total_steps={transitions + 128}", threads=options.threads)

    before = resident()

    def measure(student: Student) -> Result:
        student.env.reset(seed=0)
        space = student.env.action_space
        seen = itertools.cycle([student.env.step(space.sample()) for _ in range(64)])
        with patch.object(student.env, "step", lambda actions: next(seen)):
            student.train()
        gc.collect()
        grown, observations = float(resident() - before), 4.0 * FLOATS * transitions
        notes = {"transitions": transitions, "envs": student.env.num_envs, "ours": "student=sac, all 358 columns"}
        notes |= {"reference": "358 x 4 bytes x transitions; the growth includes actions, rewards and gait frames"}
        return Result(grown / 1e6, "MB", observations / 1e6, grown / observations, "<= 1.3", notes).rounded()

    return in_student_stage(measure, config)


def cuda(options: Options) -> Result:
    """Updates of the default student on a GPU beside the same on the processor."""
    if not torch.cuda.is_available():
        raise Unavailable("no GPU is at hand (torch.cuda.is_available() is false)")
    count = options.scaled(300)
    config = configuration("discriminator=none", "eta=1", threads=options.threads)

    def on_processor(student: Student) -> Result:
        student.fill()
        return in_student_stage(lambda other: beside(student, other), replace(config, device="cuda"))

    def beside(processor: Student, gpu: Student) -> Result:
        gpu.fill()

        def work() -> None:
            gpu.updates(count)()
            torch.cuda.synchronize()

        return compare(
            rate(work, count),
            rate(processor.updates(count), count),
            unit="updates/s",
            target=None,
            settings={"gpu": torch.cuda.get_device_name(), "threads": options.threads, "batch": 256},
            repeats=options.repeats,
        )

    return in_student_stage(on_processor, config)
