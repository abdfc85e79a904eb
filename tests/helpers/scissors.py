"""A policy of the reduced-order model that needs no training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def scissors(observation: NDArray[np.float32]) -> NDArray[np.float32]:
    """A leg in the air swings to the mirror image of the other one: runs for a few strides before it falls."""
    angle, rate, loaded = observation[:, 10:12], observation[:, 12:14], observation[:, 14:16] > 0.02
    swing = 2.0 * (-angle[:, ::-1] - angle) - 0.5 * rate
    stance = np.broadcast_to(observation[:, 2:3] - observation[:, 18:19], angle.shape)
    return np.clip(np.where(loaded, stance, swing), -1, 1).astype(np.float32)
