"""One SAC update: batch 256, 2 x 256, 358 observations and 21 actions."""

from __future__ import annotations

from typing import Any

from benchmarks import flops, sgemm
from benchmarks.measure import Options, Result, compare, rate
from benchmarks.peers import started
from benchmarks.setup import PLAIN_SAC, Student, configuration, in_student_stage

SIZES: dict[str, Any] = {"observation": 358, "action": 21, "hidden": [256, 256], "batch": 256}
TRANSITIONS, UPDATES = 10_000, 40
OURS = "student=sac, policy_delay 1"
OURS_TUNED = ("student.compact_observation=true", "student.simultaneous=true")
"""As the default student does: constant columns stay out of the networks, both gradients are taken at once."""


def against_peer(options: Options, environment: str, script: str, *, tuned: bool = True) -> Result:
    """Updates per second, sampling included, in alternation with a peer."""
    count, keys = options.scaled(UPDATES), OURS_TUNED if tuned else ()

    def measure(student: Student) -> Result:
        student.fill()
        work = {"transitions": TRANSITIONS, "updates": count}
        with started(environment, script, threads=options.threads, **SIZES, **work) as peer:
            return compare(
                rate(student.updates(count), count),
                peer.measure,
                unit="updates/s",
                target=">= 2",
                settings={**SIZES, "threads": options.threads, "ours": " ".join((OURS, *keys)), "peer": peer.settings},
                repeats=options.repeats,
            )

    return in_student_stage(measure, configuration(*PLAIN_SAC, *keys, threads=options.threads))


def against_sb3(options: Options) -> Result:
    """Stable-Baselines3's `SAC.train`."""
    return against_peer(options, "rl", "sb3_sac.py")


def against_sb3_all_columns(options: Options) -> Result:
    """The same with all 358 columns in our networks and the policy's gradient after the critics' step."""
    return against_peer(options, "rl", "sb3_sac.py", tuned=False)


def against_cleanrl(options: Options) -> Result:
    """CleanRL's script, which trains its policy twice at every second update."""
    return against_peer(options, "cleanrl", "cleanrl_sac.py")


def flops_beside(options: Options, products: list[flops.Product], reference: str) -> Result:
    """GFLOP/s of the update, useful products only, beside plain matrix products on preallocated memory."""
    useful = flops.total(flops.useful(**SIZES, policy_delay=1))
    textbook = flops.total(flops.textbook(**SIZES, policy_delay=1))
    count = options.scaled(UPDATES)
    settings = {
        **SIZES,
        "threads": options.threads,
        "ours": OURS,
        "useful MFLOP per update": round(useful / 1e6, 1),
        "textbook MFLOP per update": round(textbook / 1e6, 1),
        "sgemm": reference,
    }

    def measure(student: Student) -> Result:
        student.fill()
        return compare(
            rate(student.updates(count), count * useful / 1e9),
            sgemm.side(products, seconds=1.0),
            unit="GFLOP/s",
            target=">= 0.75",
            settings=settings,
            repeats=options.repeats,
        )

    return in_student_stage(measure, configuration(*PLAIN_SAC, threads=options.threads))


def flops_same_shapes(options: Options) -> Result:
    """Beside the update's own products, one after the other."""
    return flops_beside(options, flops.useful(**SIZES, policy_delay=1), "the useful products of the update")


def flops_square(options: Options) -> Result:
    """Beside a product that leaves the processor nothing to wait for."""
    return flops_beside(options, [sgemm.SQUARE], "2048 x 2048 x 2048")
