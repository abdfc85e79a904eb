"""What must fit where episodes of a teacher begin on the cycles of another one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from romgrl.cli.reduced_order_models import ROM_KEYS
from romgrl.cli.teacher_ranges import RANGES
from romgrl.config.schema import Config
from romgrl.config.teachers import COMMANDS, PPOTeacher
from romgrl.config.values import as_before, refusal, show
from romgrl.errors import ArtifactError, StorageError

CYCLES = "teacher.cycles"
OF_SHARE = (CYCLES, "teacher.cycle_resets", "teacher.pretrained")
OF_CYCLES = ("teacher.algorithm", "teacher.gait")
MOST_DIFFERENCES = 3


def cycle_share(config: Config) -> Iterator[str]:
    """Neither cycles nor a share of the episodes does anything without the other, or where nothing learns."""
    teacher = config.teacher
    if not isinstance(teacher, PPOTeacher):
        return
    if teacher.cycles is None and teacher.cycle_resets > 0:
        yield refusal("teacher.cycle_resets", teacher.cycle_resets, f"0 without {CYCLES}")
    elif teacher.cycles is not None and teacher.cycle_resets == 0:
        yield refusal("teacher.cycle_resets", teacher.cycle_resets, f"more than 0 with {CYCLES}")
    elif teacher.cycles is not None and teacher.pretrained:
        yield refusal(CYCLES, teacher.cycles, "null with teacher.pretrained=true")


def cycle_teacher(config: Config) -> Iterator[str]:
    """The cycles are those of a finished teacher by CMA-ES that walks on the same model, in the same gait."""
    teacher = config.teacher
    if not isinstance(teacher, PPOTeacher) or teacher.cycles is None or any(cycle_share(config)):
        return
    from romgrl.provenance.cycles import cycle_manifest, shared_ranges
    from romgrl.provenance.stage_keys import stage_settings
    from romgrl.report.terminal_tables import read_rows

    try:
        made = cycle_manifest(teacher.cycles).config
    except (ArtifactError, StorageError, OSError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        yield refusal(CYCLES, teacher.cycles, f"the directory of a teacher's finished artifact ({reason})")
        return
    usual = replace(config, teacher=replace(teacher, cycles=None))
    own = json.loads(json.dumps(stage_settings("teacher", usual)))
    wanted = {key: own[key] for key in own if key.startswith(("rom.", "humanoid.")) or key in OF_CYCLES}
    wrong = [*other_than(made, wanted | {"teacher.algorithm": "cmaes"})]
    if wrong:
        reason = ", ".join(wrong[:MOST_DIFFERENCES])
        yield refusal(CYCLES, teacher.cycles, f"a teacher by cmaes of the same rom and gait (it has {reason})")
        return
    for (one, many), (low, high) in zip(COMMANDS.items(), shared_ranges(made, own), strict=True):
        if low > high:
            has = made.get(f"teacher.{many}") or made.get(f"teacher.{one}")
            wants = own.get(f"teacher.{many}") or own.get(f"teacher.{one}")
            permitted = f"a teacher whose teacher.{many} meet {show(wants)} (it has {show(has)})"
            yield refusal(CYCLES, teacher.cycles, permitted)
            return
    checked = read_rows(Path(teacher.cycles) / "gait.csv")
    if checked and all(row["falls"] == row["episodes"] for row in checked):  # the stage tries it where both are asked
        permitted = "a teacher that stands in an episode at least (gait.csv has falls in all of them)"
        yield refusal(CYCLES, teacher.cycles, permitted)


def other_than(made: dict[str, Any], wanted: dict[str, Any]) -> Iterator[str]:
    """Yield in what the settings of an artifact, by dotted key, differ from those that are wanted."""
    for key, value in wanted.items():
        if key not in made:
            if not as_before(key, value):
                yield f"no {key} instead of {show(value)}"
        elif made[key] != value:
            yield f"{key} {show(made[key])} instead of {show(value)}"


CYCLE_CHECKS = (
    (OF_SHARE, cycle_share),
    ((*OF_SHARE, *OF_CYCLES, *RANGES, *RANGES.values(), *ROM_KEYS), cycle_teacher),
)
