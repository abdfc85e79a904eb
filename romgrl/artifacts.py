"""Artifact directories: tensors and arrays without pickle, and a manifest that proves every byte of them."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from romgrl.errors import ArtifactError

if TYPE_CHECKING:
    import torch

MANIFEST = "manifest.json"
FORMAT = 1
INTEGERS = {
    f"{sign}{bits}": f"{name}{bits}" for sign, name in (("I", "int"), ("U", "uint")) for bits in (8, 16, 32, 64)
}
FLOATS = {f"F{bits}": f"float{bits}" for bits in (16, 32, 64)}
TORCH_DTYPES = {**INTEGERS, **FLOATS, "BF16": "bfloat16", "BOOL": "bool"}  # by their names in safetensors


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


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def save_tensors(path: Path, tensors: Mapping[str, torch.Tensor], metadata: Mapping[str, str]) -> None:
    """Save tensors of any shape with string metadata in safetensors format."""
    from safetensors.torch import save

    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_bytes(path, save(contiguous, metadata=dict(metadata)))


def load_tensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    """Load what `save_tensors` wrote, onto the CPU. Raises ArtifactError naming the file."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt", device="cpu") as file:
            names = file.keys()
            return {name: file.get_tensor(name) for name in names}, dict(file.metadata() or {})
    except (OSError, SafetensorError) as error:
        raise ArtifactError(f"{path}: cannot be read: {error}") from error


def tensor_shapes(path: Path) -> dict[str, tuple[str, tuple[int, ...]]]:
    """`name: (dtype, shape)` of what `save_tensors` wrote, without torch. Raises ArtifactError naming the file."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="numpy") as file:
            slices = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
            return {name: (TORCH_DTYPES[part.get_dtype()], tuple(part.get_shape())) for name, part in slices.items()}
    except (OSError, SafetensorError) as error:
        raise ArtifactError(f"{path}: cannot be read: {error}") from error


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any] | float]) -> None:
    """Save arrays as npz; floating point becomes float32. Raises ValueError for arrays of objects."""
    converted: dict[str, Any] = {}
    for name, value in arrays.items():
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise ValueError(f"{name}: arrays of Python objects cannot be saved")
        converted[name] = array.astype(np.float32) if np.issubdtype(array.dtype, np.floating) else array
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.npz")
    try:
        np.savez_compressed(temporary, **converted)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Load what `save_arrays` wrote; pickled content is refused. Raises ArtifactError naming the file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ArtifactError(f"{path}: cannot be read: {error}") from error


def record_file(path: Path) -> FileRecord:
    """Hash a file, and list its arrays if it is npz or safetensors."""
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    arrays: dict[str, tuple[str, tuple[int, ...]]] = {}
    if path.suffix == ".npz":
        arrays = {name: (str(value.dtype), value.shape) for name, value in load_arrays(path).items()}
    elif path.suffix == ".safetensors":
        arrays = tensor_shapes(path)
    return FileRecord(sha256, path.stat().st_size, arrays)


def payload(directory: Path) -> list[str]:
    """List the relative POSIX paths of all files of an artifact except the manifest and hidden files."""
    paths = (path.relative_to(directory) for path in directory.rglob("*") if path.is_file())
    return sorted(path.as_posix() for path in paths if path.name[0] != "." and path.as_posix() != MANIFEST)


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
    """Describe every file under `directory` in manifest.json, which is written last."""
    files = {name: record_file(directory / name) for name in payload(directory)}
    manifest = Manifest(
        stage, key, config, dict(inputs), files, dict(versions), revision, dirty, seed, wall_time, run_id, threads
    )
    text = json.dumps({**asdict(manifest), "digest": manifest.digest}, indent=2, sort_keys=True)
    write_bytes(directory / MANIFEST, text.encode())
    return manifest


def read_manifest(directory: Path) -> Manifest:
    """Read manifest.json without looking at the files that it describes. Raises ArtifactError naming the file."""
    path = directory / MANIFEST
    try:
        document = json.loads(path.read_text())
        digest = document.pop("digest")
        document["files"] = {
            name: FileRecord(
                record["sha256"],
                record["size"],
                {array: (dtype, tuple(shape)) for array, (dtype, shape) in record["arrays"].items()},
            )
            for name, record in document["files"].items()
        }
        manifest = Manifest(**document)
    except FileNotFoundError as error:
        raise ArtifactError(f"{path}: missing; this is not a finished artifact") from error
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ArtifactError(f"{path}: cannot be read: {type(error).__name__}: {error}") from error
    if manifest.format != FORMAT:
        raise ArtifactError(f"{path}: format {manifest.format}, this version reads format {FORMAT}")
    if digest != manifest.digest:
        raise ArtifactError(f"{path}: its digest does not fit its list of files")
    return manifest


def open_artifact(directory: Path, *, stage: str | None = None) -> Manifest:
    """Verify SHA-256, size, dtypes and shapes of every file. Raises ArtifactError naming the first bad file."""
    manifest = read_manifest(directory)
    if stage is not None and manifest.stage != stage:
        raise ArtifactError(f"{directory / MANIFEST}: made by stage {manifest.stage}, expected {stage}")
    for name, record in manifest.files.items():
        parts = PurePosixPath(name).parts
        path = directory / name
        if PurePosixPath(name).is_absolute() or ".." in parts or not path.resolve().is_relative_to(directory.resolve()):
            raise ArtifactError(f"{directory / MANIFEST}: {name} lies outside the artifact")
        if not path.is_file():
            raise ArtifactError(f"{path}: missing")
        with path.open("rb") as file:
            if path.stat().st_size != record.size or hashlib.file_digest(file, "sha256").hexdigest() != record.sha256:
                raise ArtifactError(f"{path}: does not have the SHA-256 of its manifest; it was changed or damaged")
        if record.arrays and record_file(path) != record:
            raise ArtifactError(f"{path}: arrays do not have the shapes and dtypes of its manifest")
    extra = sorted(set(payload(directory)) - set(manifest.files))
    if extra:
        raise ArtifactError(f"{directory / extra[0]}: not listed in the manifest")
    return manifest
