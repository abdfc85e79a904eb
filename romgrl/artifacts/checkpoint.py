"""The whole state of a training on disk, and back: written whole or not at all, the one before kept until then.

A checkpoint of step N is `N.safetensors` (tensors and arrays), `N.json` (numbers, and the SHA-256 of every file), which
is written last, and segments of the replay buffer: rows that were added between two checkpoints, each written once.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from romgrl.artifacts import load_tensors, save_tensors, sync_path, write_bytes
from romgrl.errors import ArtifactError

if TYPE_CHECKING:
    from torch import Tensor

CHECKPOINT = "checkpoint"  # the directory in a stage's workspace
KEPT = 2

State = dict[str, Any]
"""Tensors, arrays, numbers, text, None, lists of numbers, and states of parts, by name."""


class Ring(Protocol):
    """A ring of rows that grows; row i of all that were ever added is there until `rows` more have come."""

    rows: int
    added: int

    def read_rows(self, first: int, last: int) -> dict[str, Tensor]:
        """Copies of the rows first ... last - 1."""

    def write_rows(self, first: int, columns: Mapping[str, Tensor]) -> None:
        """Put them back."""


class Checkpoints:
    """The checkpoints of one training in a directory; `say` is told what was damaged and set aside."""

    def __init__(self, directory: Path, *, ring: Ring | None = None, say: Callable[[str], None]) -> None:
        self.directory, self._ring, self._say = directory, ring, say
        self._segments: dict[str, dict[str, Any]] = {}

    def save(self, step: int, state: State) -> None:
        """Write the state of a step."""
        import torch

        self.directory.mkdir(exist_ok=True)
        tensors, values = {}, {}
        for name, value in flatten_state(state):
            if isinstance(value, np.ndarray):
                tensors[name] = torch.from_numpy(np.ascontiguousarray(value))
            elif isinstance(value, torch.Tensor):
                tensors[name] = value
            else:
                values[name] = value
        save_tensors(self.directory / f"{step}.safetensors", tensors, {})
        self._save_rows()
        names = [f"{step}.safetensors", *self._segments]
        files = {name: self._segments.get(name, {}).get("sha256") or self._sha256(name) for name in names}
        for name in self._segments:
            self._segments[name]["sha256"] = files[name]
        document = {"step": step, "values": values, "segments": self._segments, "files": files}
        write_bytes(self.directory / f"{step}.json", sealed(document))
        sync_path(self.directory)  # before the checkpoint that it replaces goes
        self._forget()

    def load(self) -> tuple[int, State] | None:
        """The newest whole checkpoint; a damaged one is set aside and the one before it taken. None: there is none."""
        for path in reversed(self._manifests()):
            try:
                return self._load(path)
            except ArtifactError as error:
                aside = path.with_suffix(".json.damaged")
                path.rename(aside)
                self._say(f"{error}; set aside as {aside.name}")
        return None

    def _load(self, path: Path) -> tuple[int, State]:
        document = unsealed(path)
        for name, sha256 in document["files"].items():
            if not (self.directory / name).is_file() or self._sha256(name) != sha256:
                raise ArtifactError(f"{self.directory / name}: missing or does not have the SHA-256 of its checkpoint")
        tensors, _ = load_tensors(self.directory / f"{document['step']}.safetensors")
        if self._ring is not None:
            # The oldest first: it may begin with rows that the newest have overwritten.
            for name, segment in sorted(document["segments"].items(), key=lambda part: part[1]["first"]):
                self._ring.write_rows(segment["first"], load_tensors(self.directory / name)[0])
        self._segments = document["segments"]
        return document["step"], nest(document["values"] | tensors)

    def _save_rows(self) -> None:
        """Write the rows that came since the last checkpoint, and drop the segments that the ring has overwritten."""
        if self._ring is None:
            return
        oldest, newest = max(0, self._ring.added - self._ring.rows), self._ring.added
        self._segments = {name: part for name, part in self._segments.items() if part["last"] > oldest}
        first = max([oldest, *(part["last"] for part in self._segments.values())])
        if first < newest:
            name = f"rows-{first}-{newest}.safetensors"
            save_tensors(self.directory / name, self._ring.read_rows(first, newest), {})
            self._segments[name] = {"first": first, "last": newest}

    def _forget(self) -> None:
        """Remove what the last checkpoints do not need; what was set aside stays."""
        manifests = self._manifests()
        needed = {name for path in manifests[-KEPT:] for name in readable_state(path).get("files", ())}
        for path in manifests[:-KEPT]:
            path.unlink()
        for path in self.directory.glob("*.safetensors"):
            if path.name not in needed:
                path.unlink()

    def _manifests(self) -> list[Path]:
        return sorted(self.directory.glob("*.json"), key=lambda path: int(path.stem))

    def _sha256(self, name: str) -> str:
        with (self.directory / name).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()


def flatten_state(state: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of a nested state under names joined by slashes."""
    for name, value in state.items():
        if isinstance(value, Mapping):
            yield from flatten_state(value, f"{prefix}{name}/")
        else:
            yield prefix + name, value


def nest(leaves: Mapping[str, Any]) -> State:
    """What `flatten` took apart; empty parts are lost."""
    state: State = {}
    for path, value in leaves.items():
        *above, name = path.split("/")
        place = state
        for part in above:
            place = place.setdefault(part, {})
        place[name] = value
    return state


def sealed(document: Mapping[str, Any]) -> bytes:
    """JSON with its own SHA-256 in the first line."""
    text = json.dumps(document, sort_keys=True).encode()
    return hashlib.sha256(text).hexdigest().encode() + b"\n" + text


def readable_state(path: Path) -> dict[str, Any]:
    """What `sealed` wrote, or nothing."""
    try:
        return unsealed(path)
    except ArtifactError:
        return {}


def unsealed(path: Path) -> dict[str, Any]:
    """What `sealed` wrote. Raises ArtifactError naming the file."""
    try:
        seal, _, text = path.read_bytes().partition(b"\n")
        if hashlib.sha256(text).hexdigest().encode() != seal:
            raise ArtifactError(f"{path}: does not have its own SHA-256; it was changed or damaged")
        document: dict[str, Any] = json.loads(text)
        return document
    except OSError as error:
        raise ArtifactError(f"{path}: cannot be read: {error}") from error
