"""What a student that follows commands does not go with: stages that know one speed, and what follows its checks."""

from __future__ import annotations

from collections.abc import Iterator

from romgrl.config.commanded import is_conditioned
from romgrl.config.schema import Config
from romgrl.config.values import refusal, show, value_of

FOLLOWED = ("teacher", "reference", "library", "student", "baseline", "sync")
"""The values of `stage` that a conditioned student has; its evaluation over the grid of commands will be one more."""
OF_ONE_SPEED = {
    "student.pretrained": False,
    "student.adapt_eta": False,
    "student.end_early": False,
    "student.second_try": False,
    "discriminator.imitated": "teacher",
    "discriminator.reward": "recomputed",
}
CONDITIONED_KEYS = ("student.kind", "stage", "discriminator.loss", *OF_ONE_SPEED)


def conditioned_student(config: Config) -> Iterator[str]:
    """A student that follows commands is made, but not yet evaluated, exported or watched; none ships."""
    if not is_conditioned(config):
        return
    where = f"with student.kind={config.student.kind}"
    if config.stage not in FOLLOWED:
        yield refusal("stage", config.stage, f"{', '.join(FOLLOWED)} {where}: it has no one speed")
    for key, needed in OF_ONE_SPEED.items():
        if value_of(config, key) != needed:
            yield refusal(key, value_of(config, key), f"{show(needed)} {where}")
    if config.discriminator.loss == "wasserstein":
        yield refusal("discriminator.loss", "wasserstein", f"bce or least_squares {where}: each command has its level")
