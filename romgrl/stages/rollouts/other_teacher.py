"""Another seed's teacher to compare with: the one that ships, where it walks the same reduced-order model."""

from __future__ import annotations

import numpy as np

from romgrl.config.schema import Config
from romgrl.config.values import show
from romgrl.errors import ArtifactError
from romgrl.gait.alignment import comparable
from romgrl.gait.features import Floats
from romgrl.provenance import shipped
from romgrl.stages.rollouts.teacher import roll_out_teacher

SAME = 1e-3  # m; the paths of one teacher differ by less on two machines, those of two teachers by more


def other_teacher(config: Config, reference: list[Floats]) -> list[Floats]:
    """The episodes (T_i, 5) of the teacher that ships. Raises ArtifactError with the reason why there are none."""
    differing = [each for each in shipped.other_settings("teacher", config) if each[0] != "seed"]
    if differing:
        key, value, trained = differing[0]
        raise ArtifactError(f"the teacher that ships was trained with {key} {show(trained)}, not {show(value)}")
    gait = roll_out_teacher(shipped.PLACE / "teacher", config)
    if not comparable(gait):
        raise ArtifactError(f"the teacher that ships falls in {int(gait.fallen.sum())} of {len(gait.fallen)} episodes")
    found = gait.upright_episodes
    if same_episodes(found, reference):
        raise ArtifactError("the teacher that ships is the one in use")
    return found


def same_episodes(found: list[Floats], reference: list[Floats]) -> bool:
    """Tell whether the paths of two references are the same as far as both go."""
    return all(
        np.allclose(one[: len(other)], other[: len(one)], atol=SAME)
        for one, other in zip(found, reference, strict=False)
    )
