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
        """Mirror image of `values` (..., K)."""
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

    Raises ValueError where a name has no other side.
    """
    place = {name: index for index, name in enumerate(names)}
    alone = [name for name in names if other_side(name) not in place]
    if alone:
        raise ValueError(f"{alone[0]} has no mirror image: there is no {other_side(alone[0])}")
    order = [place[other_side(name)] for name in names]
    return Mirror(np.array(order, np.int64), np.array([-1.0 if n in negated else 1.0 for n in names], np.float32))


def left_or_right(name: str) -> str:
    """The name on the other side of one that may begin with its side: left_load -> right_load; height -> height."""
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)
