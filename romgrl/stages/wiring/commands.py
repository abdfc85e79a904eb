"""What is asked of the worlds of a teacher: one speed and stiffness, or ranges that one policy learns to follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from romgrl.config.schema import Config
from romgrl.rom.parameters import Commands

GRID = 5  # speeds at which a teacher of a range is checked, its ends among them

Asked = float | Commands


def asked(config: Config) -> Asked:
    """What the configuration asks of a trained teacher."""
    teacher = config.teacher
    if teacher.stiffness_share == 1.0:
        return teacher.speed
    return Commands((teacher.speed, teacher.speed), (teacher.stiffness_share, teacher.stiffness_share))


def asked_in_training(config: Config) -> Asked:
    """What worlds are asked for while the teacher learns."""
    teacher = config.teacher
    if teacher.speeds is None and teacher.stiffness_shares is None:
        return asked(config)
    low, high = teacher.speeds or (teacher.speed, teacher.speed)
    soft, stiff = teacher.stiffness_shares or (teacher.stiffness_share, teacher.stiffness_share)
    return Commands((low, high), (soft, stiff), teacher.command_steps)


def checked_tasks(config: Config) -> list[Config]:
    """The configurations at which a teacher is checked: its own, or one for each of GRID speeds and each stiffness."""
    teacher = config.teacher
    if teacher.speeds is None and teacher.stiffness_shares is None:
        return [config]
    low, high = teacher.speeds or (teacher.speed, teacher.speed)
    speeds = dict.fromkeys(np.linspace(low, high, GRID).tolist())
    shares = sorted({*(teacher.stiffness_shares or [teacher.stiffness_share])})
    return [
        replace(config, teacher=replace(teacher, speed=speed, stiffness_share=share))
        for speed in speeds
        for share in shares
    ]


def name_of_task(config: Config) -> str:
    """What a teacher is called at the speed and stiffness of a configuration, where it can follow others, too."""
    teacher = config.teacher
    name = "teacher" if teacher.speeds is None else f"teacher at {teacher.speed:g} m/s"
    return name if teacher.stiffness_shares is None else f"{name}, stiffness x {teacher.stiffness_share:g}"
