"""Puts the state of a checkpoint back into the parts of a training, or says what in it does not fit them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch

from romgrl.artifacts.checkpoint import State, flatten_state
from romgrl.errors import ArtifactError

MISFITS = (ArtifactError, AttributeError, IndexError, KeyError, OverflowError, RuntimeError, TypeError, ValueError)
"""What parts and libraries raise where a state is not theirs."""
MOMENTS = ("exp_avg", "exp_avg_sq")
LONGEST_REASON = 300  # characters


@runtime_checkable
class Stateful(Protocol):
    """A part of a training whose state can be taken and put back."""

    def state(self) -> State:
        """All that its next steps depend on."""

    def restore(self, state: State) -> None:
        """Go on from a state."""


def restore_all(parts: Mapping[str, Stateful], state: State, fresh: State) -> None:
    """Let all parts go on from a state; `fresh` is the one that they have.

    Raises ArtifactError with what does not fit; then some may have gone on, but none has an attribute more.
    """
    try:
        for wrong in lacking(fresh, state):
            raise ArtifactError(wrong)
        for name in sorted(state.keys() - parts.keys()):
            raise ArtifactError(f"{name} is more than this training has")
        for name, part in parts.items():
            before = set(attributes(part))
            part.restore(state[name])
            added = sorted(set(attributes(part)) - before)
            for more in added:
                delattr(part, more)
            if added:
                raise ArtifactError(f"{name}/{added[0]} is more than this training has")
            for wrong in changes(state[name], part.state(), f"{name}/"):
                raise ArtifactError(wrong)
            for wrong in bad_moments(part, name):
                raise ArtifactError(wrong)
    except MISFITS as error:
        text = str(error) if isinstance(error, ArtifactError) else f"{type(error).__name__}: {error}"
        raise ArtifactError(" ".join(text.split())[:LONGEST_REASON]) from error


def lacking(needed: Mapping[str, Any], found: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield what a state lacks, or has in another form than the one that is needed."""
    for name, value in needed.items():
        if isinstance(value, Mapping):
            inner = found.get(name, {})  # empty parts are lost in a checkpoint
            if isinstance(inner, Mapping):
                yield from lacking(value, inner, f"{prefix}{name}/")
            else:
                yield f"{prefix}{name} is {form(inner)}, needed are parts"
        elif name not in found:
            yield f"{prefix}{name} is missing"
        elif value is not None and form(found[name]) != form(value):
            yield f"{prefix}{name} is {form(found[name])}, needed is {form(value)}"


def changes(given: Mapping[str, Any], taken: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """Yield where a part does not return what it was given."""
    before, after = ({name: form(value) for name, value in flatten_state(each)} for each in (given, taken))
    for name in sorted(before.keys() | after.keys()):
        if name not in after:
            yield f"{prefix}{name} is more than this training has"
        elif before.get(name) != after[name]:
            yield f"{prefix}{name} is {before.get(name, 'missing')}, needed is {after[name]}"


def form(value: Any) -> str:
    """Shape and dtype of an array or a tensor, the kind of anything else; JSON has one kind of numbers."""
    if isinstance(value, np.ndarray | torch.Tensor):
        return f"{tuple(value.shape)} {value.dtype}".replace("torch.", "")
    if isinstance(value, Mapping):
        return "parts"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "a number"
    return {bool: "true or false", str: "text", list: "a list"}.get(type(value), "nothing")


def attributes(part: object) -> dict[str, Any]:
    """What a part holds."""
    return getattr(part, "__dict__", {})


def bad_moments(part: object, prefix: str) -> Iterator[str]:
    """Yield what in the optimisers of a part and its parts is not of their parameters: torch takes it, and fails later.

    Nothing is what an optimiser has before its first step.
    """
    for name, value in attributes(part).items():
        if isinstance(value, torch.optim.Optimizer):
            places = {parameter: parameter.shape for group in value.param_groups for parameter in group["params"]}
            for parameter, entry in value.state.items():
                shape = places.get(parameter)
                needed = {"step": torch.Size(()), **dict.fromkeys(MOMENTS, shape)}
                if shape is None or {key: getattr(each, "shape", None) for key, each in entry.items()} != needed:
                    yield f"{prefix}/{name} has no moments of the shape of its parameters"
        elif isinstance(value, Stateful):
            yield from bad_moments(value, f"{prefix}/{name}")
