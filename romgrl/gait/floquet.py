"""Orbital stability: Floquet multipliers, the eigenvalues of the linearised return map of a periodic motion.

A return map takes a state on a section across the orbit to the state at the next crossing, x' = P(x). Near its fixed
point P(x*) = x* a deviation grows or shrinks by the eigenvalues of J = dP/dx at x*; the orbit is stable if all of them
are smaller than one in modulus (Guckenheimer and Holmes 1983, section 1.5; Strogatz 2015, section 8.7; for walking:
Hurmuzlu and Moskowitz 1986, Dyn. Stab. Syst. 1:223).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Map = Callable[[Array], Array]  # states (B, n) to states (B, n) at the next crossing; nan where there is none
RESAMPLES = 1000
CONFIDENCE = (2.5, 97.5)  # percent


@dataclass(frozen=True)
class Multipliers:
    """values (n,) complex, largest modulus first; low, high: 95 % bootstrap interval of the largest modulus.

    right, left (n,): eigenvectors of the largest, of length one.
    """

    values: NDArray[np.complex128]
    right: NDArray[np.complex128]
    left: NDArray[np.complex128]
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """stable or unstable; undecided where the interval of the largest modulus holds one."""
        largest = float(np.abs(self.values[0]))
        low, high = (self.low, self.high) if np.isfinite(self.low) else (largest, largest)
        return "stable" if high < 1 else "unstable" if low > 1 else "undecided"

    @property
    def slowest(self) -> Array:
        """Rows (1, n), or (2, n) for a complex pair, that take a deviation to its part that goes with the largest."""
        return np.stack((self.left.real, self.left.imag)) if self.values[0].imag else self.left.real[None]

    @property
    def direction(self) -> Array:
        """A deviation (n,) of length one that goes with the largest."""
        return np.asarray(self.right.real / np.linalg.norm(self.right.real))


def jacobians(return_map: Map, points: Array, steps: Array) -> Array:
    """dP/dx at each of `points` (M, n) by central differences of size `steps` (n,): (M, n, n).

    All disturbed states are mapped at once, as 2 n M rows; row i belongs to point i % M.
    """
    count, size = points.shape
    offsets = np.concatenate((np.diag(steps), -np.diag(steps)))
    rows = (points[None] + offsets[:, None]).reshape(-1, size)
    images = return_map(rows).reshape(2, size, count, size)
    slopes = (images[0] - images[1]) / (2 * steps)[:, None, None]  # (disturbed, M, observed)
    return np.asarray(slopes.transpose(1, 2, 0))


def multipliers(matrices: Array, *, seed: int = 0) -> Multipliers:
    """Multipliers of the mean of `matrices` (M, n, n), the bootstrap drawing whole matrices (Efron 1979).

    One matrix has no interval: nan.
    """
    mean = matrices.mean(axis=0)
    (values, right), (_, left) = _sorted_eigen(mean), _sorted_eigen(mean.T)
    means = np.tensordot(_resampled(len(matrices), seed), matrices, axes=1)
    return Multipliers(values, right[:, 0], left[:, 0], *_interval(means))


def decay(responses: Array, *, seed: int = 0) -> Multipliers:
    """Multipliers of the A that fits r[k + 1] = A r[k] best, where r (K, m) is the mean of `responses` (M, K, m).

    With few components m and many crossings K it tells the largest ones better than the derivative at one crossing:
    what a deviation does to a phase that goes on by itself, and that phase to later crossings, is in it.
    """
    shares = _resampled(len(responses), seed)
    found = multipliers(_predictor(responses.mean(axis=0)[None]))
    low, high = _interval(_predictor(np.tensordot(shares, responses, axes=1)))
    return replace(found, low=low, high=high)


def _sorted_eigen(matrix: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Eigenvalues (n,), largest modulus first, and their eigenvectors in columns (n, n)."""
    values, vectors = np.linalg.eig(matrix)
    order = np.argsort(-np.abs(values), kind="stable")
    return values[order].astype(complex), vectors[:, order].astype(complex)


def _predictor(responses: Array) -> Array:
    """Least-squares A (S, m, m) of each of `responses` (S, K, m)."""
    now, later = responses[:, :-1], responses[:, 1:]
    return np.asarray((np.linalg.pinv(now) @ later).transpose(0, 2, 1))


def _resampled(count: int, seed: int) -> Array:
    """Weights (RESAMPLES, count) of draws with replacement; none of a single one."""
    draws = RESAMPLES if count > 1 else 0
    return np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), draws) / count


def _interval(matrices: Array) -> tuple[float, float]:
    """95 % of the largest moduli of `matrices` (S, n, n); nan for none."""
    if not len(matrices):
        return float("nan"), float("nan")
    low, high = np.percentile(np.abs(np.linalg.eigvals(matrices)).max(axis=1), CONFIDENCE)
    return float(low), float(high)
