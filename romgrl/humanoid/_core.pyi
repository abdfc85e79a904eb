from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

NO_TIME: int
"""Address of a C function without arguments that returns 0.0."""

POSTURE_SIZE: int

class PlanarBodies:
    def __init__(
        self,
        *,
        parents: Sequence[int],
        joints: Sequence[int],
        offsets: Sequence[Sequence[float]],
        x_axes: Sequence[Sequence[float]],
        z_axes: Sequence[Sequence[float]],
        rest: Sequence[float],
        left_ankle: int,
        right_ankle: int,
        neck: int,
        head: int,
        soles: Sequence[tuple[int, bool, Sequence[float], float]],
    ) -> None: ...
    def observe(
        self,
        qpos: NDArray[np.float64],
        qvel: NDArray[np.float64],
        columns: NDArray[np.int32],
        observation: NDArray[np.float32],
        posture: NDArray[np.float64],
    ) -> None: ...
