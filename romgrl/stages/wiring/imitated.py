"""What a student imitates: the reference, or cosines of its cadence and amplitudes in its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from romgrl.config.schema import Config
from romgrl.errors import ArtifactError
from romgrl.gait.features import gait_from_reference
from romgrl.gait.metrics import steady_steps, stride_frequency
from romgrl.gait.null_models import sinusoids
from romgrl.stages.wiring.artifact_arrays import Arrays, read_reference


def read_imitated(directory: Path, config: Config, *, steps: int = 1) -> Arrays:
    """As `read_reference`; where `discriminator.imitated` is sinusoid, the first harmonics of its paths.

    Raises ArtifactError where the reference has no strides.
    """
    arrays = read_reference(directory, config, steps=steps)
    return first_harmonics(directory, arrays) if config.discriminator.imitated == "sinusoid" else arrays


def first_harmonics(directory: Path, arrays: Arrays) -> Arrays:
    """A reference of as many episodes, each as long as the longest, without contacts and speeds."""
    gait = gait_from_reference(arrays)
    cadence = stride_frequency(gait.features, gait.dt, steady_steps(gait.valid, gait.dt))
    if not cadence > 0:
        raise ArtifactError(f"{directory}: no strides; discriminator.imitated=sinusoid needs their cadence")
    episodes = sinusoids(gait.upright_episodes, gait.dt, cadence, gait.valid.shape[1])
    return {
        "features": np.concatenate(episodes).astype(np.float32),
        "episode": np.repeat(np.arange(len(episodes), dtype=np.int32), gait.valid.shape[1]),
        "dt": arrays["dt"],
        "speed": arrays["speed"],
    }
