"""Teacher, student and baseline next to one another in one film, at the same scale and on the same ground."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from romgrl.report.style import COLORS, WALKER_LABELS

FILM = "side_by_side.mp4"
Picture = NDArray[np.uint8]
HUMANOID_GROUND = 0.95  # where the feet stand in a picture of the humanoid, share of its height
TEXT = 0.045  # height of the names, share of the picture's


@dataclass(frozen=True)
class FilmedTeacher:
    """The arrays of reference.npz, and the reduced-order model that made them."""

    arrays: Mapping[str, NDArray[Any]]
    parameters: Any
    draw: Callable[..., Picture]
    ground: float  # where it lies in what `draw` makes, share of the height

    def frames(self, size: tuple[int, int], steps: int) -> list[Picture]:
        """Pictures (height, width, 3) of the last `steps` steps of the longest episode."""
        features, episode = self.arrays["features"], self.arrays["episode"]
        episodes, counts = np.unique(episode, return_counts=True)
        rows = np.flatnonzero(episode == episodes[counts.argmax()])[-steps:]
        contact = self.arrays.get("contact", np.zeros((len(features), 2), bool))
        speed = self.arrays.get("velocity", np.full(len(features), self.arrays["speed"]))
        places = np.cumsum(speed[rows]) * float(self.arrays["dt"])
        return [
            on_ground(self.draw(features[row], contact[row], float(x), self.parameters), size, self.ground)
            for row, x in zip(rows, places, strict=True)
        ]


def on_ground(picture: Picture, size: tuple[int, int], ground: float) -> Picture:
    """The middle of a picture of the reduced-order model on a larger canvas, its ground where the humanoid's is."""
    height, width = size
    top = round(HUMANOID_GROUND * height - ground * picture.shape[0])
    left = (picture.shape[1] - width) // 2
    canvas = np.empty((height, width, 3), np.uint8)
    canvas[:] = picture[0, 0]
    canvas[top:] = picture[: height - top, left : left + width]
    return canvas


def together(columns: Mapping[str, Sequence[Picture]]) -> Iterator[Picture]:
    """Pictures of all walkers side by side, with their names; one that fell early stays as it was last."""
    for step in range(max(map(len, columns.values()))):
        yield np.concatenate([named(each[min(step, len(each) - 1)], name) for name, each in columns.items()], axis=1)


def named(frame: Picture, name: str) -> Picture:
    """A picture with the name of its walker at the top, in its colour."""
    image = Image.fromarray(frame)
    size = round(TEXT * frame.shape[0])
    canvas = ImageDraw.Draw(image)
    canvas.text((size // 2, size // 2), WALKER_LABELS[name], fill=COLORS[name], font=ImageFont.load_default(size))
    return np.asarray(image)
