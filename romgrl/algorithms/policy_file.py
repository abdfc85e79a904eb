"""Policies in files: a network is rebuilt only from sizes that its own tensors have."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from romgrl.artifacts import load_tensors
from romgrl.errors import ArtifactError
from romgrl.gait.symmetry import Mirror

NETWORK = "network"  # the metadata that holds the sizes, as JSON
COLUMN_NAMES = "observation_names"  # in there: of the columns that the policy reads
Shape = tuple[int, ...]


class PolicyFile(NamedTuple):
    """What a file says: its tensors, sizes and options of the network, the humanoid, the names of what it reads."""

    tensors: dict[str, Tensor]
    network: dict[str, Any]
    humanoid: Any
    observation_names: list[str] | None  # files of old have none


def read_policy(
    path: Path, *, algorithm: str, sizes: tuple[str, str], options: Mapping[str, Collection[Any]]
) -> PolicyFile:
    """The file of a policy of `algorithm`, or ArtifactError.

    The description must have just the `sizes`, whole numbers, the list `hidden_sizes`, and each of `options` with one
    of its values; names, if any, are as many as the first size. No tensor may hold a number that is not finite.
    """
    tensors, metadata = load_tensors(path)
    try:
        network = json.loads(metadata[NETWORK])
        found, humanoid, names = (
            network.pop("algorithm"),
            network.pop("humanoid", None),
            network.pop(COLUMN_NAMES, None),
        )
    except (KeyError, ValueError, AttributeError, TypeError, RecursionError) as error:
        raise ArtifactError(f"{path}: does not describe its network; needed: metadata `{NETWORK}`") from error
    require(path, "algorithm", found, algorithm)
    require(path, "description of the network", sorted(network), sorted([*sizes, "hidden_sizes", *options]))
    hidden = network["hidden_sizes"]
    if not isinstance(hidden, list) or not all(type(size) is int and size > 0 for size in hidden):
        raise ArtifactError(f"{path}: hidden_sizes {hidden}; needed: whole numbers above 0")
    for name in sizes:
        if type(network[name]) is not int or network[name] < 1:
            raise ArtifactError(f"{path}: {name} {network[name]!r}; needed: a whole number above 0")
    for name, values in options.items():
        if not any(network[name] is value or network[name] == value for value in values):
            raise ArtifactError(f"{path}: {name} {network[name]!r}; needed: {', '.join(map(str, values))}")
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and not bool(torch.isfinite(tensor).all()):
            raise ArtifactError(f"{path}: {name} holds numbers that are not finite")
    if names is not None and (not isinstance(names, list) or len(names) != network[sizes[0]]):
        raise ArtifactError(
            f"{path}: {COLUMN_NAMES} {names!r:.80}; needed: {network[sizes[0]]} names, one for each column"
        )
    return PolicyFile(tensors, network, humanoid, names)


def require_names(path: Path, found: Sequence[str] | None, needed: Sequence[str]) -> None:
    """Raise ArtifactError for the first column that a policy knows by another name; one without names may be any."""
    for column, (one, other) in enumerate(zip(found or (), needed, strict=False)):
        if one != other:
            raise ArtifactError(f"{path}: column {column} of what it reads is {one}; needed: {other}")


def check_tensors(path: Path, tensors: Mapping[str, Tensor], needed: Mapping[str, tuple[torch.dtype, Shape]]) -> None:
    """Raise ArtifactError unless a file holds the tensors `needed`, and no other."""
    missing, extra = sorted(set(needed) - set(tensors)), sorted(set(tensors) - set(needed))
    if missing or extra:
        raise ArtifactError(f"{path}: {'no' if missing else 'an unknown'} tensor {', '.join(missing or extra)}")
    for name, (dtype, shape) in needed.items():
        tensor = tensors[name]
        if tensor.dtype != dtype or tuple(tensor.shape) != shape:
            raise ArtifactError(f"{path}: {name} is {tensor.dtype} {tuple(tensor.shape)}; needed: {dtype} {shape}")


def read_mirror(path: Path, tensors: Mapping[str, Tensor], permutation: str, sign: str) -> Mirror:
    """The mirror that two tensors of a file describe; ArtifactError unless twice the image is the original."""
    mirror = Mirror(tensors[permutation], tensors[sign])
    numbers = torch.arange(len(mirror.sign))
    inside = bool(((mirror.permutation >= 0) & (mirror.permutation < len(numbers))).all())
    signed = bool((mirror.sign.abs() == 1).all())
    if not (inside and signed and torch.equal(mirror.image(mirror.image(numbers + 1.0)), numbers + 1.0)):
        raise ArtifactError(f"{path}: {permutation} and {sign} are no mirror: twice the image is not the original")
    return mirror


def require(path: Path, name: str, found: object, needed: object) -> None:
    """Raise ArtifactError, naming both, unless a file has what is needed."""
    if found != needed:
        raise ArtifactError(f"{path}: {name} {found}; needed: {needed}")


def require_humanoid(path: Path, trained_on: Any, needed: Mapping[str, str]) -> None:
    """Raise ArtifactError, saying in words what differs, unless a policy was trained on this humanoid.

    Both have a `fingerprint` beside the words that explain it; policies of old have it alone.
    """
    words = trained_on if isinstance(trained_on, dict) else {"fingerprint": trained_on}
    if words.get("fingerprint") == needed["fingerprint"]:
        return
    known = {name: value for name, value in needed.items() if name != "fingerprint"}
    differing = [
        f"{name} {words[name]} in training, {value} now"
        for name, value in known.items()
        if name in words and words[name] != value
    ]
    if not differing and known.keys() <= words.keys():
        differing = ["other joints or actuators, or other names of them"]
    this = ", ".join(f"{name} {value}" for name, value in known.items())
    told = "; ".join(differing) or f"it does not say which; this one: {this}"
    raise ArtifactError(f"{path}: trained on another humanoid: {told}")


def layer_sizes(network: Mapping[str, Any], inputs: str, outputs: str) -> Sequence[tuple[int, int]]:
    """Inputs and outputs of each layer."""
    return list(pairwise([network[inputs], *network["hidden_sizes"], network[outputs]]))
