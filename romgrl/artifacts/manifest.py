"""The manifest of an artifact: what it is, what it was made from, and the proof of every byte of it."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from romgrl.artifacts.payload import array_shapes, tensor_shapes
from romgrl.artifacts.storage import storage_faults, tree, write_bytes
from romgrl.errors import ArtifactError

MANIFEST = "manifest.json"
FORMAT = 2
LARGEST_MANIFEST = 2**20  # bytes; ours have some thousand
PLAIN_PART = re.compile(r"[A-Za-z0-9_-]([A-Za-z0-9_.-]{0,253}[A-Za-z0-9_-])?")
SUFFIXES = ("csv", "html", "json", "md", "mp4", "npz", "pdf", "png", "safetensors", "txt")
"""Data that nothing executes."""
EXPORT_SUFFIXES = ("onnx", "py", "xml")
"""What an export has beside them, which is for use elsewhere: no stage reads it, no tracking server gives it."""
SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class FileRecord:
    """One file: its SHA-256, its size in bytes, and `name: [dtype, shape]` of the arrays in it."""

    sha256: str
    size: int
    arrays: dict[str, tuple[str, tuple[int, ...]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Manifest:
    """What an artifact is and was made from; `inputs` maps an upstream stage to the digest of its artifact."""

    stage: str
    key: str
    config: dict[str, Any]
    inputs: dict[str, str]
    files: dict[str, FileRecord]
    versions: dict[str, str]
    revision: str | None
    dirty: bool | None
    seed: int
    wall_time: float
    run_id: str | None = None
    threads: int | None = None
    format: int = FORMAT

    @property
    def digest(self) -> str:
        """SHA-256 over the names and digests of all files: two artifacts with the same payload have the same digest."""
        lines = "".join(f"{name} {record.sha256}\n" for name, record in sorted(self.files.items()))
        return hashlib.sha256(lines.encode()).hexdigest()

    @property
    def text(self) -> str:
        """manifest.json, one text for one manifest; `checksum` is the SHA-256 of the same text without it."""
        document = {**asdict(self), "digest": self.digest}
        document["checksum"] = hashlib.sha256(_json(document).encode()).hexdigest()
        return _json(document)


def record_file(path: Path) -> FileRecord:
    """Hash a file, and list its arrays if it is npz or safetensors."""
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    shapes = {".npz": array_shapes, ".safetensors": tensor_shapes}.get(path.suffix)
    return FileRecord(sha256, path.stat().st_size, shapes(path) if shapes else {})


def payload(directory: Path) -> list[str]:
    """The relative POSIX paths of all files of an artifact except the manifest and hidden files, which nothing reads.

    Raises ArtifactError for a link, a socket and whatever else is neither a file nor a directory.
    """
    found = []
    for path in tree(directory):
        name = path.relative_to(directory).as_posix()
        if path.name.startswith(".") or name == MANIFEST:
            continue
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise ArtifactError(f"{path}: neither a file nor a directory")
        if path.is_file():
            found.append(name)
    return found


def check_name(directory: Path, name: str, stage: str) -> None:
    """Raise ArtifactError unless a name leads to data in the artifact of a stage, on every system: letters, digits and
    _ . -"""
    if not all(PLAIN_PART.fullmatch(part) for part in name.split("/")):
        raise ArtifactError(f"{directory / MANIFEST}: {name!r} is not the name of a file of an artifact")
    allowed = SUFFIXES + (EXPORT_SUFFIXES if stage == "export" else ())
    if name.rpartition(".")[2] not in allowed:
        raise ArtifactError(f"{directory / MANIFEST}: {name} is none of the kinds {', '.join(allowed)}")


def write_manifest(
    directory: Path,
    *,
    stage: str,
    key: str,
    config: dict[str, Any],
    inputs: Mapping[str, str],
    versions: Mapping[str, str],
    revision: str | None,
    dirty: bool | None,
    seed: int,
    wall_time: float,
    run_id: str | None = None,
    threads: int | None = None,
) -> Manifest:
    """Describe every file under `directory` in manifest.json, which is written last. Raises StorageError."""
    with storage_faults(directory):
        names = payload(directory)
        for name in names:
            check_name(directory, name, stage)
        files = {name: record_file(directory / name) for name in names}
    manifest = Manifest(
        stage, key, config, dict(inputs), files, dict(versions), revision, dirty, seed, wall_time, run_id, threads
    )
    write_bytes(directory / MANIFEST, manifest.text.encode())
    return manifest


def read_manifest(directory: Path) -> Manifest:
    """Read manifest.json without looking at the files that it describes. Raises ArtifactError naming the file.

    Nothing in it is ever instantiated, and its text must be what `Manifest.text` makes of its content.
    """
    path = directory / MANIFEST
    with storage_faults(path):
        try:
            if path.is_symlink() or path.stat().st_size > LARGEST_MANIFEST:
                raise ArtifactError(f"{path}: is a link, or larger than {LARGEST_MANIFEST} bytes")
            text = path.read_text(encoding="utf-8")
            document = json.loads(text, parse_constant=_refuse_constant)
            if (found := document.pop("format")) != FORMAT:
                raise ArtifactError(f"{path}: format {found}, this version reads format {FORMAT}")
            del document["digest"], document["checksum"]
            records = document.pop("files")
            manifest = Manifest(**document, files={name: _record(record) for name, record in records.items()})
            fits = manifest.text == text
        except (FileNotFoundError, NotADirectoryError) as error:
            raise ArtifactError(f"{path}: missing; this is not a finished artifact") from error
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ArtifactError(f"{path}: cannot be read: {type(error).__name__}: {error}") from error
    if not fits:
        raise ArtifactError(f"{path}: does not have its own checksum; it was changed or damaged")
    _check_types(path, manifest)
    for name in manifest.files:
        check_name(directory, name, manifest.stage)
    return manifest


def _json(document: Mapping[str, Any]) -> str:
    return json.dumps(document, indent=2, sort_keys=True)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")


def _record(record: Any) -> FileRecord:
    """A FileRecord from JSON. Raises ValueError, KeyError or TypeError for anything else."""
    arrays = {name: (str(dtype), tuple(shape)) for name, (dtype, shape) in record["arrays"].items()}
    sizes = [record["size"], *(length for _, shape in arrays.values() for length in shape)]
    if not SHA256.fullmatch(record["sha256"]) or not all(type(size) is int and 0 <= size < 2**63 for size in sizes):
        raise ValueError("not the record of a file")
    return FileRecord(record["sha256"], record["size"], arrays)


def _check_types(path: Path, manifest: Manifest) -> None:
    """Raise ArtifactError naming the first field of another type than Manifest says."""
    text, number, optional = (str,), (int, float), type(None)
    types: dict[str, tuple[type, ...]] = {
        **dict.fromkeys(("stage", "key"), text),
        **dict.fromkeys(("config", "inputs", "versions"), (dict,)),
        **dict.fromkeys(("revision", "run_id"), (str, optional)),
        "dirty": (bool, optional),
        "seed": (int,),
        "wall_time": number,
        "threads": (int, optional),
    }
    values = [(name, getattr(manifest, name), allowed) for name, allowed in types.items()]
    digests = manifest.inputs.values() if isinstance(manifest.inputs, dict) else ()
    for name, value, allowed in [*values, *(("inputs", value, text) for value in digests)]:
        if not isinstance(value, allowed) or (isinstance(value, bool) and bool not in allowed):
            raise ArtifactError(f"{path}: {name} has the type {type(value).__name__}")
