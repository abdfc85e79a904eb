"""Left and right exchanged: the mirror image of a gait in its sagittal plane, for every vector that describes it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

Values = TypeVar("Values", "Tensor", NDArray[Any])


class Mirror(NamedTuple):
    """Column i of the image is sign[i] times column permutation[i] of the original; arrays or tensors (K,) each."""

    permutation: Any
    sign: Any

    def image(self, values: Values) -> Values:
        """Mirror image of `values` (..., K); ValueError for another number of columns."""
        if values.shape[-1:] != self.sign.shape:
            raise ValueError(f"the mirror is one of {len(self.sign)} columns, not of {[*values.shape[-1:]]}")
        image: Values = values[..., self.permutation] * self.sign
        return image

    def kept(self, columns: NDArray[np.int64]) -> Mirror:
        """Mirror of a vector that holds only `columns` of this one; ValueError unless they mirror among themselves."""
        place = {int(column): i for i, column in enumerate(columns)}
        try:
            order = [place[int(self.permutation[column])] for column in place]
        except KeyError as missing:
            raise ValueError(f"column {missing} is dropped, but its mirror image is kept") from missing
        return Mirror(np.array(order, np.int64), self.sign[columns])

    def tensors(self, device: str = "cpu") -> Mirror:
        """The same as tensors on a device."""
        import torch  # environments, which have mirrors, do without

        return Mirror(*(torch.as_tensor(part, device=device) for part in self))


def unsigned(permutation: Sequence[int] | NDArray[np.int64]) -> Mirror:
    """Mirror that exchanges columns and negates none."""
    order = np.asarray(permutation, np.int64)
    return Mirror(order, np.ones(len(order), np.float32))


def by_name(names: Sequence[str], other_side: Callable[[str], str], negated: Collection[str] = ()) -> Mirror:
    """Mirror of named columns: each becomes that of its name on the other side, those `negated` with the other sign.

    Raises ValueError where a name has no other side or stands twice, for an unknown name in `negated`, and where the
    image of the image is not the original.
    """
    place = {name: index for index, name in enumerate(names)}
    if len(place) < len(names):
        twice = next(name for index, name in enumerate(names) if place[name] != index)
        raise ValueError(f"{twice} stands twice among the names")
    others = [other_side(name) for name in names]
    for name, other in zip(names, others, strict=True):
        if other not in place:
            raise ValueError(f"{name} has no mirror image: there is no {other}")
        if others[place[other]] != name:
            raise ValueError(f"the mirror image of {name} is {other}, whose own is {others[place[other]]}")
        if (name in negated) != (other in negated):
            raise ValueError(f"of {name} and its mirror image {other} only one is negated")
    unknown = [name for name in negated if name not in place]
    if unknown:
        raise ValueError(f"{unknown[0]} is negated, but is none of the names")
    order = [place[other] for other in others]
    return Mirror(np.array(order, np.int64), np.array([-1.0 if n in negated else 1.0 for n in names], np.float32))


def left_or_right(name: str) -> str:
    """The name on the other side of one that may begin with its side: left_load -> right_load; height -> height."""
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)
