"""A fast drawing of one spring-leg world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw

from romgrl.rom.parameters import SpringLegParameters

WIDTH, HEIGHT = 640, 360
GROUND = 0.82  # where it lies, share of the height
_OVERSAMPLING = 2
_SKY, _GROUND, _MARK = (250, 250, 248), (222, 219, 210), (165, 160, 148)
_TRUNK, _LEGS = (55, 65, 81), ((37, 99, 235), (217, 83, 25))  # left blue, right orange
_MOTOR = (120, 128, 140)
MOTOR_LENGTH = 0.4
"""Of a leg's motor as it is drawn, share of the leg length: its rod comes out of it as far as the rest length grows."""
TRUNK = 0.12
"""Half of the trunk's side, m."""
SOLE = 30.0
"""Half of the arc that a foot rolls on as it is drawn, degrees: as far as a leg leans in a walk, and more."""
Point = tuple[float, float]


def _spring(start: Point, end: Point, amplitude: float) -> list[Point]:
    """Zigzag between two points, straight at both ends."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy) or 1.0
    across = (-dy / length * amplitude, dx / length * amplitude)
    points = [start]
    turns = 12
    for i in range(turns + 1):
        share = 0.2 + 0.6 * i / turns
        side = 0.0 if i in (0, turns) else (1.0 if i % 2 else -1.0)
        points.append((start[0] + share * dx + side * across[0], start[1] + share * dy + side * across[1]))
    return [*points, end]


def _draw_motor(canvas: ImageDraw.ImageDraw, hip: Point, foot: Point, length: float, extension: float) -> Point:
    """A motor on the leg and the end of its rod, where the spring begins. Lengths in pixels."""
    dx, dy = foot[0] - hip[0], foot[1] - hip[1]
    whole = math.hypot(dx, dy) or 1.0

    def along(distance: float) -> Point:
        return hip[0] + distance / whole * dx, hip[1] + distance / whole * dy

    end, housing = max(length + extension, 0.0), 0.7 * length
    canvas.line((hip, along(end)), fill=_MOTOR, width=14)
    canvas.line((hip, along(min(housing, end))), fill=_TRUNK, width=34)
    return along(end)


def _draw_sole(
    canvas: ImageDraw.ImageDraw, hip: Point, foot: Point, radius: float, height: float, colour: tuple[int, int, int]
) -> None:
    """The arc that a foot rolls on, as far below the leg's end as it is high. Lengths in pixels."""
    dx, dy = foot[0] - hip[0], foot[1] - hip[1]
    whole = math.hypot(dx, dy) or 1.0
    centre = foot[0] - (radius - height) / whole * dx, foot[1] - (radius - height) / whole * dy
    box = (centre[0] - radius, centre[1] - radius, centre[0] + radius, centre[1] + radius)
    down = math.degrees(math.atan2(dy, dx))
    canvas.arc(box, down - SOLE, down + SOLE, fill=colour, width=10)


def draw(
    features: ArrayLike,
    contact: ArrayLike,
    x: float,
    parameters: SpringLegParameters,
    extension: ArrayLike | None = None,
) -> NDArray[np.uint8]:
    """Image (360, 640, 3) uint8 of a world, trunk centred: features (5,) m, contact (2,) bool, x of the trunk in m.

    extension (2,): of the rest length of legs with motors beyond leg_length, m, which are drawn with them.
    """
    values = np.asarray(features, np.float64)
    scale = 0.6 * HEIGHT * _OVERSAMPLING / (parameters.leg_length + parameters.foot_radius)
    horizon = max(GROUND * HEIGHT * _OVERSAMPLING, scale * (values[0] + TRUNK))  # a jump takes the view with it
    centre = 0.5 * WIDTH * _OVERSAMPLING

    def pixel(forward: float, up: float) -> Point:
        return centre + scale * forward, horizon - scale * up

    image = Image.new("RGB", (WIDTH * _OVERSAMPLING, HEIGHT * _OVERSAMPLING), _SKY)
    canvas = ImageDraw.Draw(image)
    right, bottom = WIDTH * _OVERSAMPLING, HEIGHT * _OVERSAMPLING
    canvas.rectangle((0, min(horizon, bottom), right, bottom), fill=_GROUND)
    reach = int(centre / scale) + 1
    for metre in range(math.floor(x) - reach, math.ceil(x) + reach + 1):  # a mark every metre
        mark = pixel(metre - x, 0.0)
        canvas.line((mark[0], mark[1], mark[0] - 12, mark[1] + 24), fill=_MARK, width=4)
    hip = pixel(0.0, values[0])
    for side in (1, 0):
        radius = parameters.foot_radius * scale
        foot = pixel(values[1 + 2 * side], values[0] + values[2 + 2 * side])
        upper = hip
        if extension is not None:
            rod = float(np.asarray(extension)[side])
            upper = _draw_motor(canvas, hip, foot, scale * parameters.leg_length * MOTOR_LENGTH, scale * rod)
        canvas.line(_spring(upper, foot, 0.045 * scale), fill=_LEGS[side], width=6, joint="curve")
        filled = _LEGS[side] if np.asarray(contact)[side] else _SKY
        if parameters.roll_over_radius:
            _draw_sole(canvas, hip, foot, scale * parameters.roll_over_radius, radius, _LEGS[side])
            radius = 0.5 * parameters.foot_radius * scale  # the ankle, which is above the sole
        box = (foot[0] - radius, foot[1] - radius, foot[0] + radius, foot[1] + radius)
        canvas.ellipse(box, fill=filled, outline=_LEGS[side], width=6)
    half = TRUNK * scale
    canvas.rounded_rectangle((hip[0] - half, hip[1] - half, hip[0] + half, hip[1] + half), half / 3, fill=_TRUNK)
    image = image.resize((WIDTH, HEIGHT), Image.Resampling.BOX)
    return np.asarray(image, np.uint8).copy()
