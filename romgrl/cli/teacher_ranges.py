"""What must fit together where a teacher learns a range of speeds or of stiffness."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from romgrl.cli.reduced_order_models import ROM_KEYS, composed_parameters
from romgrl.config.commanded import needs_library
from romgrl.config.schema import Config
from romgrl.config.teachers import COMMANDS, CMAESTeacher
from romgrl.config.values import refusal, show, value_of

MOTORS = "variable_leg"
OF_MOTORS = {"teacher.stiffness_share": 1.0, "teacher.stiffness_shares": None}
JUMPING = "jump"
OF_JUMPING = ("teacher", "reference", "library")
"""The stages that know of an apex."""
LARGEST_LIBRARY = 10_000  # cells
OF_OTHERS = {"teacher.apex": 0.0, "teacher.apexes": None}
OF_SEARCH = {"teacher.reward": "exponential", "teacher.command_steps": 0, "teacher.pretrained": False}
SEARCH_KEYS = (
    *("teacher.algorithm", "teacher.degree", "teacher.speeds", "teacher.apexes"),
    *("teacher.population", "teacher.rollouts"),
)
MOST_WORLDS = 100_000
"""That the C++ core steps together."""
OF_COMMANDS = {"teacher.speeds": None, "teacher.work_cost": 0.0}
STEPS = {"library.speed_step": "teacher.speeds", "library.apex_step": "teacher.apexes"}
RANGES = {f"teacher.{name}": f"teacher.{of}" for name, of in COMMANDS.items()}


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


def library_within_range(config: Config) -> Iterator[str]:
    """A library asks a teacher for what it has learned."""
    learned, shares = config.teacher.stiffness_shares, config.library.stiffness_shares
    if needs_library(config) and learned is not None and not learned[0] <= min(shares) <= max(shares) <= learned[1]:
        yield refusal("library.stiffness_shares", shares, f"within teacher.stiffness_shares = {show(learned)}")


def size_of_library(config: Config) -> Iterator[str]:
    """The cells of a library can be made."""
    for step, of in STEPS.items():
        ends, value = value_of(config, of), value_of(config, step)
        if needs_library(config) and ends is not None and not (ends[1] - ends[0]) / LARGEST_LIBRARY <= value:
            yield refusal(step, value, f"at least {(ends[1] - ends[0]) / LARGEST_LIBRARY:g} with {of} = {show(ends)}")


def of_model(config: Config) -> Iterator[str]:
    """Not all worlds are asked for another speed each episode, or tell what their work costs, or have motors."""
    from romgrl.rom.registry import MODELS

    model = config.rom.model
    lacks = ({} if model == MOTORS else OF_MOTORS) | ({} if MODELS[model].commands else OF_COMMANDS)
    for key, usual in lacks.items():
        if value_of(config, key) != usual:
            yield refusal(key, value_of(config, key), f"{show(usual)} with rom.model={model}")


def of_search(config: Config) -> Iterator[str]:
    """CMA-ES finds a controller of legs with motors, whose clock it needs, by its mean speed, held for an episode."""
    teacher = config.teacher
    if not isinstance(teacher, CMAESTeacher):
        return
    if config.rom.model != MOTORS:
        yield refusal("teacher.algorithm", "cmaes", f"ppo with rom.model={config.rom.model}")
    if teacher.degree > 1 and teacher.speeds is None and teacher.apexes is None:
        yield refusal("teacher.degree", teacher.degree, "1 without teacher.speeds and teacher.apexes")
    if teacher.population * teacher.rollouts > MOST_WORLDS:
        permitted = f"at most {MOST_WORLDS // teacher.population} with teacher.population={teacher.population}"
        yield refusal("teacher.rollouts", teacher.rollouts, permitted)
    for key, usual in OF_SEARCH.items():
        if value_of(config, key) != usual:
            yield refusal(key, value_of(config, key), f"{show(usual)} with teacher.algorithm=cmaes")


def of_jumps(config: Config) -> Iterator[str]:
    """Jumps alone have an apex, which the reward of PPO does not know."""
    teacher = config.teacher
    if teacher.gait != JUMPING:
        for key, usual in OF_OTHERS.items():
            if value_of(config, key) != usual:
                yield refusal(key, value_of(config, key), f"{show(usual)} with teacher.gait={teacher.gait}")
    elif teacher.algorithm != "cmaes":
        yield refusal("teacher.gait", JUMPING, f"another gait with teacher.algorithm={teacher.algorithm}")
    elif config.stage not in OF_JUMPING:
        yield refusal("teacher.gait", JUMPING, f"another gait with stage={config.stage}: no student follows an apex")
    elif teacher.speed != 0 or teacher.speeds is not None:
        key = "teacher.speeds" if teacher.speed == 0 else "teacher.speed"
        yield refusal(key, value_of(config, key), f"{'null' if teacher.speed == 0 else 0} with teacher.gait={JUMPING}")
    elif not teacher.apex > 0 or (teacher.apexes is not None and not min(teacher.apexes) > 0):
        key = "teacher.apexes" if teacher.apex > 0 else "teacher.apex"
        yield refusal(key, value_of(config, key), f"above 0 with teacher.gait={JUMPING}")


def trained_ranges(config: Config) -> Iterator[str]:
    """The teacher that ships learned one speed."""
    for key in RANGES.values() if config.teacher.pretrained else ():
        if value_of(config, key) is not None:
            yield refusal(key, value_of(config, key), "null with teacher.pretrained=true")


def stiffest_legs(config: Config) -> Iterator[str]:
    """The stiffest of a range can be integrated, too."""
    from romgrl.rom.registry import MODELS

    share = max(config.teacher.stiffness_shares or [config.teacher.stiffness_share])
    if config.rom.model != MOTORS or share <= 1:
        return
    parameters = composed_parameters(config)
    stiffest = replace(parameters, stiffness=share * parameters.stiffness)
    if [*MODELS[MOTORS].faults(stiffest, config.humanoid.control_frequency)]:
        key = "teacher.stiffness_share" + ("s" if config.teacher.stiffness_shares else "")
        permitted = f"less, or more rom.substeps: legs of {stiffest.stiffness:g} N/m cannot be integrated"
        yield refusal(key, value_of(config, key), permitted)


RANGE_CHECKS = (
    ((*RANGES, *RANGES.values()), asked_within_range),
    (("teacher.command_steps", "teacher.speeds", "teacher.stiffness_shares"), commands_within_range),
    (("stage", "student.kind", "library.stiffness_shares", "teacher.stiffness_shares"), library_within_range),
    (("rom.model", *OF_MOTORS, *OF_COMMANDS), of_model),
    ((*SEARCH_KEYS, "rom.model", *OF_SEARCH), of_search),
    (("stage", "teacher.gait", "teacher.algorithm", "teacher.speed", "teacher.speeds", *OF_OTHERS), of_jumps),
    (("stage", "student.kind", *STEPS, *STEPS.values()), size_of_library),
    (("teacher.pretrained", *RANGES.values()), trained_ranges),
    ((*ROM_KEYS, "teacher.stiffness_share", "teacher.stiffness_shares"), stiffest_legs),
)
