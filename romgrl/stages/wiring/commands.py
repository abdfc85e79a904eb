"""What is asked of the worlds of a teacher: one speed and stiffness, or ranges that one policy learns to follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from romgrl.config.schema import Config
from romgrl.config.teachers import has_range
from romgrl.rom.parameters import Commands

GRID = 5  # speeds or apexes at which a teacher of a range is checked, its ends among them

Asked = float | Commands


def asked(config: Config) -> Asked:
    """What the configuration asks of a trained teacher."""
    teacher = config.teacher
    if teacher.stiffness_share == 1.0 and teacher.apex == 0.0:
        return teacher.speed
    speed, share, apex = ((value, value) for value in (teacher.speed, teacher.stiffness_share, teacher.apex))
    return Commands(speed, share, apex=apex)


def asked_in_training(config: Config) -> Asked:
    """What worlds are asked for while the teacher learns."""
    teacher = config.teacher
    if not has_range(teacher):
        return asked(config)
    low, high = teacher.speeds or (teacher.speed, teacher.speed)
    soft, stiff = teacher.stiffness_shares or (teacher.stiffness_share, teacher.stiffness_share)
    least, most = teacher.apexes or (teacher.apex, teacher.apex)
    return Commands((low, high), (soft, stiff), teacher.command_steps, (least, most))


def checked_tasks(config: Config) -> list[Config]:
    """The configurations at which a teacher is checked: its own, or each of GRID speeds and apexes by stiffness."""
    teacher = config.teacher
    if not has_range(teacher):
        return [config]
    speeds = grid(teacher.speeds or (teacher.speed, teacher.speed))
    apexes = grid(teacher.apexes or (teacher.apex, teacher.apex))
    shares = sorted({*(teacher.stiffness_shares or [teacher.stiffness_share])})
    return [
        replace(config, teacher=replace(teacher, speed=speed, stiffness_share=share, apex=apex))
        for speed, apex, share in product(speeds, apexes, shares)
    ]


def searched_tasks(config: Config) -> list[Config]:
    """The configurations at which a search tries its controllers: those of the checks, and at the usual stiffness.

    What is linear in the stiffness is held between its ends, too, where a third of a library's cells are.
    """
    tasks, shares = checked_tasks(config), config.teacher.stiffness_shares
    if shares is None or not shares[0] < 1.0 < shares[1]:
        return tasks
    usual = [replace(at, teacher=replace(at.teacher, stiffness_share=1.0)) for at in tasks[:: len({*shares})]]
    return [*tasks, *usual]


def grid(ends: Sequence[float]) -> list[float]:
    """GRID values between two ends, or the one that both are."""
    low, high = ends
    return [*dict.fromkeys(np.linspace(low, high, GRID).tolist())]


def name_of_task(config: Config) -> str:
    """What a teacher is called at the speed and stiffness of a configuration, where it can follow others, too."""
    teacher = config.teacher
    name = "teacher" if teacher.speeds is None else f"teacher at {teacher.speed:g} m/s"
    name += "" if teacher.apexes is None else f" to {teacher.apex:g} m"
    return name if teacher.stiffness_shares is None else f"{name}, stiffness x {teacher.stiffness_share:g}"
