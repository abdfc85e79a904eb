"""Reference: a rollout of the trained teacher in the feature contract (paper section 3.2)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from romgrl.artifacts import save_arrays
from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import CHANNELS, POWERS, Gait
from romgrl.gait.footfall import FOOTFALLS
from romgrl.gait.reference_check import check_reference
from romgrl.runtime.stage_log import StageLog
from romgrl.stages.rollouts.teacher import roll_out_as_asked


def run(config: Config, inputs: Mapping[str, Path], output: Path, log: StageLog) -> None:
    """Roll the deterministic teacher out from several resets and write reference.npz; ArtifactError if it is unfit.

    With `reference.check` false an unfit one is written, too, falls and all.
    """
    reference = config.reference
    told = roll_out_as_asked(inputs["teacher"], config)
    gait = told.gait
    try:
        log.metrics(check_reference(gait, FOOTFALLS[config.teacher.gait]), reference.steps)
        how = f"{reference.steps} steps in {reference.episodes} episodes{told.words(config)}"
        log.message(f"{how}, fit to be imitated")
    except ArtifactError as error:
        if reference.check:
            raise
        log.message(f"warning: {error}")
        gait.valid[:, reference.warmup_steps :] = True
    write_reference(output / "reference.npz", gait, speed=config.teacher.speed, steps=reference.steps)


def write_reference(path: Path, gait: Gait, *, speed: float, steps: int) -> None:
    """reference.npz: the first `steps` valid steps, one episode after the other, and how many episodes fell."""
    assert gait.velocity is not None
    assert gait.contact is not None
    powers = {name: getattr(gait, name) for name in POWERS}
    save_arrays(
        path,
        {
            "features": gait.features[gait.valid][:steps].astype(np.float32),
            "episode": np.nonzero(gait.valid)[0][:steps].astype(np.int32),
            "contact": gait.contact[gait.valid][:steps],
            "velocity": gait.velocity[gait.valid][:steps].astype(np.float32),
            **{name: told[gait.valid][:steps].astype(np.float32) for name, told in powers.items() if told is not None},
            "falls": float(gait.fallen.sum()),
            "channels": np.array(CHANNELS),
            "dt": gait.dt,
            "speed": speed,
        },
    )
