"""The whole state of a training on disk, and back: written whole or not at all, the one before kept until then.

A checkpoint of step N is `N.safetensors` (tensors and arrays), `N.json` (numbers, and the SHA-256 of every file), which
is written last, and segments of the replay buffer: rows that were added between two checkpoints, each written once.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from romgrl.artifacts import load_tensors, save_tensors, sync_path, tensor_shapes, write_bytes
from romgrl.errors import ArtifactError

if TYPE_CHECKING:
    from torch import Tensor

CHECKPOINT = "checkpoint"  # the directory in a stage's workspace
KEPT = 2

State = dict[str, Any]
"""Tensors, arrays, numbers, text, None, lists of numbers, and states of parts, by name."""


class Ring(Protocol):
    """A ring of rows that grows; row i of all that were ever added is there until `rows` more have come.

    Rows to which none was added yet are zero.
    """

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
                self._set_aside(path, str(error))
        return None

    def require_rows(self) -> None:
        """Raise ArtifactError where the ring says that more or fewer rows were added than `load` has put back."""
        last = max((segment["last"] for segment in self._segments.values()), default=0)
        if self._ring is not None and self._ring.added != last:
            raise ArtifactError(f"the replay buffer has {last} rows, needed are {self._ring.added}")

    def refuse(self, step: int, reason: str) -> None:
        """Set aside what `load` returned, because it does not fit; the ring is as before."""
        path = self.directory / f"{step}.json"
        if self._ring is not None:
            for segment in self._segments.values():
                rows = self._ring.read_rows(segment["first"], segment["last"])
                self._ring.write_rows(segment["first"], {name: column.zero_() for name, column in rows.items()})
        self._segments = {}
        self._set_aside(path, f"{path}: does not fit this training: {reason}")

    def _set_aside(self, path: Path, reason: str) -> None:
        aside = path.with_suffix(".json.damaged")
        path.rename(aside)
        self._say(f"{reason}; set aside as {aside.name}")

    def _load(self, path: Path) -> tuple[int, State]:
        document = unsealed(path)
        for name, sha256 in document["files"].items():
            if not (self.directory / name).is_file() or self._sha256(name) != sha256:
                raise ArtifactError(f"{self.directory / name}: missing or does not have the SHA-256 of its checkpoint")
        tensors, _ = load_tensors(self.directory / f"{document['step']}.safetensors")
        try:
            state = nest(document["values"] | tensors)
        except ValueError as error:
            raise ArtifactError(f"{path}: is no checkpoint: {error}") from error
        if self._ring is not None:
            # The oldest first: it may begin with rows that the newest have overwritten.
            segments = sorted(document["segments"].items(), key=lambda part: part[1]["first"])
            self._check_rows(path, segments)
            for name, segment in segments:
                self._ring.write_rows(segment["first"], load_tensors(self.directory / name)[0])
        self._segments = document["segments"]
        return document["step"], state

    def _check_rows(self, path: Path, segments: Sequence[tuple[str, Mapping[str, int]]]) -> None:
        """Raise ArtifactError unless the segments hold all rows that the ring held, in its columns."""
        assert self._ring is not None
        columns = self._ring.read_rows(0, 1)
        for name, segment in segments:
            count = segment["last"] - segment["first"]
            needed = {
                column: (str(rows.dtype).removeprefix("torch."), (count, *rows.shape[1:]))
                for column, rows in columns.items()
            }
            if (found := tensor_shapes(self.directory / name)) != needed:
                wrong = sorted(key for key in found.keys() | needed.keys() if found.get(key) != needed.get(key))
                what = f"{wrong[0]} is {found.get(wrong[0], 'missing')}, needed is {needed.get(wrong[0], 'none')}"
                raise ArtifactError(f"{self.directory / name}: does not fit this training: {what}")
        bounds = [(segment["first"], segment["last"]) for _, segment in segments]
        gaps = any(last != first for (_, last), (first, _) in pairwise(bounds))
        if bounds and (gaps or bounds[0][0] > max(0, bounds[-1][1] - self._ring.rows)):
            raise ArtifactError(f"{path}: does not fit this training: rows of the replay buffer are missing")

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
        return sorted(
            (path for path in self.directory.glob("*.json") if path.stem.isdecimal()), key=lambda path: int(path.stem)
        )

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
    """What `flatten_state` took apart; empty parts are lost. Raises ValueError where a part is a value, too."""
    state: State = {}
    for path, value in leaves.items():
        *above, name = path.split("/")
        place = state
        for part in above:
            place = place.setdefault(part, {})
            if not isinstance(place, dict):
                raise ValueError(f"{path} is below a value")
        if name in place:
            raise ValueError(f"{path} is a value and a part")
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
    """What `sealed` wrote of a checkpoint. Raises ArtifactError naming the file."""
    try:
        seal, _, text = path.read_bytes().partition(b"\n")
        if hashlib.sha256(text).hexdigest().encode() != seal:
            raise ArtifactError(f"{path}: does not have its own SHA-256; it was changed or damaged")
        document: dict[str, Any] = json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise ArtifactError(f"{path}: cannot be read: {error}") from error
    if wrong := malformed(document, path.stem):
        raise ArtifactError(f"{path}: is no checkpoint: {wrong}")
    return document


def malformed(document: Any, stem: str) -> str:
    """What keeps JSON from being that of a checkpoint; nothing where it is one."""
    if not isinstance(document, dict):
        return "it is no mapping"
    for name in ("values", "segments", "files"):
        if not isinstance(document.get(name), dict):
            return f"it has no mapping `{name}`"
    if type(document.get("step")) is not int or str(document["step"]) != stem:
        return "its step is not the one that it is named after"
    for name, segment in document["segments"].items():
        first, last = (segment.get(end) if isinstance(segment, dict) else None for end in ("first", "last"))
        if not (isinstance(first, int) and isinstance(last, int) and 0 <= first < last):
            return f"{name} has no first and last row"
    missing = [name for name in (f"{stem}.safetensors", *document["segments"]) if name not in document["files"]]
    return f"it has no SHA-256 of {missing[0]}" if missing else ""
