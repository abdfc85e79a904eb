"""Numbers that no healthy training shows: they stop it before anything is saved."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from romgrl.errors import DivergenceError

LIMIT = 1e8
"""Largest norm of an array of observations, rewards, losses, gradients or weights; healthy ones stay below 1e5."""


def require_finite(**arrays: Any) -> None:
    """Raise DivergenceError naming the first of these arrays or tensors that holds NaN or has a norm beyond LIMIT."""
    for name, array in arrays.items():
        flat = array.reshape(-1)
        norm = math.sqrt(float(flat.dot(flat)))  # a third of the time of a maximum; NaN and inf survive in it
        if not norm <= LIMIT:
            raise DivergenceError(f"{name.replace('_', ' ')} has norm {norm:.3g}, allowed is {LIMIT:.0e} at most")


def check_physics(diverged: NDArray[np.bool_]) -> None:
    """Raise DivergenceError where a simulation left the numbers that bodies can have."""
    if diverged.any():
        worlds = ", ".join(map(str, np.flatnonzero(diverged)[:8]))
        raise DivergenceError(f"physics diverged in environment {worlds}")
