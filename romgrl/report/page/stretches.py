"""The steady stretch of a cell of a library that the page plays: a few strides that end as they began."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from romgrl.gait.features import Bools, Floats
from romgrl.report.page.scene import gone
from romgrl.report.page.strides import USUAL, landings

STRIDES = (3, 2)  # of a stretch: two where no three of them close
CLOSED = 0.05  # m: as far as any feature may be at the end from where it was at the start


@dataclass(frozen=True)
class Stretch:
    """T steps of a cell, which begin and end as the left foot lands: features (T, 5) m, contact (T, 2), x (T,) m.

    strides: the steps at which it lands, the first and the last of the stretch among them; first: the step of the
    record at which it begins.
    """

    features: Floats
    contact: Bools
    x: Floats
    strides: list[int]
    first: int


def steady_stretch(
    features: Floats, contact: Bools, velocity: Floats, episode: NDArray[np.integer], *, dt: float
) -> Stretch | None:
    """The stretch of a cell that ends most nearly as it began; None where it has none, as of a walker that falls.

    features (T, 5) m, contact (T, 2), velocity (T,) m/s, episode (T,), -1 where there is nothing.
    """
    landed = []
    for number in np.unique(episode[episode >= 0]):
        steps = np.flatnonzero(episode == number)
        landed.append([int(steps[at]) for at in landings(features[steps], contact[steps, 0], dt)])

    def closing(starts: list[int]) -> float:
        return float(np.abs(features[starts[-1]] - features[starts[0]]).max())

    for strides in STRIDES:
        runs = [starts[at : at + strides + 1] for starts in landed for at in range(len(starts) - strides)]
        best = min(filter(usual, runs), key=closing, default=None)
        if best is not None and closing(best) <= CLOSED:
            kept = slice(best[0], best[-1] + 1)
            return Stretch(
                features[kept], contact[kept], gone(velocity[kept], dt), [at - best[0] for at in best], best[0]
            )
    return None


def usual(starts: list[int]) -> bool:
    """Whether strides that begin at these steps are about equally long."""
    lengths = np.diff(starts)
    return bool(lengths.min() >= USUAL[0] * np.median(lengths) and lengths.max() <= USUAL[1] * np.median(lengths))
