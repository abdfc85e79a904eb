"""Mirrors: of names, of kept columns, of arrays and tensors."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from romgrl.gait.symmetry import Mirror, by_name, left_or_right

NAMES = ("height", "left_load", "right_load", "side")


def test_names_exchange_sides_and_what_tells_a_side_changes_its_sign() -> None:
    mirror = by_name(NAMES, left_or_right, negated=("side",))
    np.testing.assert_array_equal(mirror.image(np.array([[1.0, 2.0, 3.0, 4.0]])), [[1.0, 3.0, 2.0, -4.0]])
    assert mirror.sign.dtype == np.float32


def test_a_name_without_its_other_side_is_refused() -> None:
    with pytest.raises(ValueError, match="right_load"):
        by_name(("height", "left_load"), left_or_right)


@pytest.mark.parametrize(
    ("names", "other_side", "reason"),
    [
        (("left", "right", "left"), {"left": "right", "right": "left"}, "left stands twice"),
        (("a", "b", "c"), {"a": "b", "b": "c", "c": "a"}, "the mirror image of a is b, whose own is c"),
        (("a", "b", "c"), {"a": "b", "b": "a", "c": "a"}, "the mirror image of c is a, whose own is b"),
        (("a", "b"), {"a": "a", "b": "a"}, "the mirror image of b is a, whose own is a"),
    ],
)
def test_a_map_that_is_not_its_own_inverse_is_refused(
    names: tuple[str, ...], other_side: dict[str, str], reason: str
) -> None:
    with pytest.raises(ValueError, match=f"^{reason}"):
        by_name(names, other_side.__getitem__)


@pytest.mark.parametrize(
    ("negated", "reason"),
    [
        (("pitch",), "pitch is negated, but is none of the names"),
        (("left_load",), "of left_load and its mirror image right_load only one is negated"),
    ],
)
def test_signs_that_cannot_be_are_refused(negated: tuple[str, ...], reason: str) -> None:
    with pytest.raises(ValueError, match=f"^{reason}$"):
        by_name(NAMES, left_or_right, negated=negated)


@pytest.mark.parametrize("shape", [(5, 3), (5, 5), (4, 1), ()])
def test_another_number_of_columns_is_refused(shape: tuple[int, ...]) -> None:
    mirror = by_name(NAMES, left_or_right, negated=("side",))
    for of, values in ((mirror, np.zeros(shape)), (mirror.tensors(), torch.zeros(shape))):
        with pytest.raises(ValueError, match=r"^the mirror is one of 4 columns, not of"):
            of.image(values)


def test_arrays_and_tensors_have_the_same_image() -> None:
    mirror = by_name(NAMES, left_or_right, negated=("side",))
    values = np.random.default_rng(0).normal(size=(5, 4)).astype(np.float32)
    np.testing.assert_array_equal(mirror.tensors().image(torch.from_numpy(values)).numpy(), mirror.image(values))


def test_kept_columns_mirror_among_themselves() -> None:
    mirror = Mirror(np.array([0, 3, 4, 1, 2]), np.array([1, -1, 1, -1, 1], dtype=np.float32))
    kept = mirror.kept(np.array([1, 3, 0]))
    assert kept.permutation.tolist() == [1, 0, 2]
    assert kept.sign.tolist() == [-1, -1, 1]
    with pytest.raises(ValueError, match="mirror image"):
        mirror.kept(np.array([1, 0]))
