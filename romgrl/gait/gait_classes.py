"""Which gait an episode shows, by what tells gaits apart in `romgrl.gait.footfall`.

An episode is of the gait whose footfall it fits: the phase of the right touchdown within `off`, the share of flight in
its range, the correlation of the feet's x not above its limit. Of several it is the one with the nearest phase. Walk
and run have the same phase, and a slow run need not fly: without flight what vaults over its stance leg is a walk, what
sinks on it a run (McMahon, Valiant & Frederick 1987, J. Appl. Physiol. 62:2326). A skip that leads with the other foot
is the mirror image of one, and a skip, too. An episode that falls, stands, or fits nothing has no gait.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from romgrl.gait.features import BODY_Y, Bools, Gait
from romgrl.gait.footfall import FOOTFALLS, Footfall
from romgrl.gait.metrics import (
    infer_contact,
    left_right_correlation,
    mid_stance_rise,
    steady_steps,
    touchdown_phase,
)

OF_NO_GAIT = "none"
CLASSES = ("walk", "run", "hop", "skip")
"""Gaits that are told apart: a jump is a hop that is asked for a height."""


def classified(gait: Gait) -> list[str]:
    """One of CLASSES, or OF_NO_GAIT, for each episode, by its steady steps; contacts that were not recorded are guessed
    from velocities, and an episode without either has no gait."""
    contact = gait.contact
    if contact is None and gait.velocity is not None:
        contact = infer_contact(gait.features, gait.velocity, gait.dt, gait.valid)
    if contact is None:
        return [OF_NO_GAIT] * len(gait.features)
    valid = steady_steps(gait.valid, gait.dt)
    return [
        OF_NO_GAIT if gait.fallen[row] else _class_of(episode(gait, row), contact[row : row + 1], valid[row : row + 1])
        for row in range(len(gait.features))
    ]


def episode(gait: Gait, rows: int | slice) -> Gait:
    """Some episodes of a gait, without loads."""
    rows = slice(rows, rows + 1) if isinstance(rows, int) else rows
    parts: dict[str, Any] = {name: value[rows] for name, value in vars(gait).items() if isinstance(value, np.ndarray)}
    return replace(gait, loads=None, **parts)


def _class_of(gait: Gait, contact: Bools, valid: Bools) -> str:
    """Of the one episode of a gait; contact (1, T, 2), valid (1, T)."""
    phase = touchdown_phase(contact, valid)
    if not np.isfinite(phase):
        return OF_NO_GAIT
    flight = 1.0 - float(contact[valid].any(axis=1).mean())
    correlation = left_right_correlation(gait.features, valid)
    off = {
        name: phase_off(phase, FOOTFALLS[name])
        for name in CLASSES
        if _fits(FOOTFALLS[name], phase, flight=flight, correlation=correlation)
    }
    if {"walk", "run"} <= off.keys():
        off.pop("run" if mid_stance_rise(gait.features[..., BODY_Y], contact, valid) > 0 else "walk")
    return min(off, key=lambda name: off[name]) if off else OF_NO_GAIT


def phase_off(phase: float, footfall: Footfall) -> float:
    """How far a phase of the right touchdown is from that of a gait or of its mirror image, strides."""
    return min(abs((side - footfall.phase + 0.5) % 1.0 - 0.5) for side in (phase, -phase))


def _fits(footfall: Footfall, phase: float, *, flight: float, correlation: float) -> bool:
    least, most = footfall.flight
    feet = correlation <= footfall.correlation or footfall.correlation >= 1.0  # nan where feet do not swing
    return feet and least <= flight <= most and phase_off(phase, footfall) <= footfall.off
