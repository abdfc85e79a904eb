"""What must fit together where a teacher learns a range of speeds or of stiffness."""

from __future__ import annotations

from collections.abc import Iterator

from romgrl.config.schema import Config
from romgrl.config.values import refusal, show, value_of

MOTORS = "variable_leg"
RANGES = {"teacher.speed": "teacher.speeds", "teacher.stiffness_share": "teacher.stiffness_shares"}


def asked_within_range(config: Config) -> Iterator[str]:
    """What is asked of a teacher of a range lies in it."""
    for key, of in RANGES.items():
        ends = value_of(config, of)
        if ends is not None and not ends[0] <= value_of(config, key) <= ends[1]:
            yield refusal(key, value_of(config, key), f"within {of} = {show(ends)}")


def commands_within_range(config: Config) -> Iterator[str]:
    """Commands change within an episode where there is something to draw them from."""
    teacher = config.teacher
    if teacher.command_steps and teacher.speeds is None and teacher.stiffness_shares is None:
        permitted = "0 without teacher.speeds and teacher.stiffness_shares"
        yield refusal("teacher.command_steps", teacher.command_steps, permitted)


def seen_stiffness(config: Config) -> Iterator[str]:
    """A policy follows the stiffness that it sees, and pays for motors that there are."""
    teacher, permitted = config.teacher, f"without rom.model={MOTORS}"
    if config.rom.model != MOTORS and teacher.stiffness_shares is not None:
        yield refusal("teacher.stiffness_shares", teacher.stiffness_shares, f"null {permitted}")
    if config.rom.model != MOTORS and teacher.leg_motor_cost:
        yield refusal("teacher.leg_motor_cost", teacher.leg_motor_cost, f"0 {permitted}")


RANGE_CHECKS = (
    (("teacher.speed", "teacher.speeds", "teacher.stiffness_share", "teacher.stiffness_shares"), asked_within_range),
    (("teacher.command_steps", "teacher.speeds", "teacher.stiffness_shares"), commands_within_range),
    (("rom.model", "teacher.stiffness_shares", "teacher.leg_motor_cost"), seen_stiffness),
)
