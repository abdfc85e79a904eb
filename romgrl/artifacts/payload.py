"""Tensors as safetensors and arrays as npz: no pickle, neither written nor read."""

from __future__ import annotations

import io
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from romgrl.artifacts.storage import FAULTS, storage_faults, write_bytes
from romgrl.errors import ArtifactError

if TYPE_CHECKING:
    import torch

Shapes = dict[str, tuple[str, tuple[int, ...]]]  # name: dtype and shape

INTEGERS = {
    f"{sign}{bits}": f"{name}{bits}" for sign, name in (("I", "int"), ("U", "uint")) for bits in (8, 16, 32, 64)
}
FLOATS = {f"F{bits}": f"float{bits}" for bits in (16, 32, 64)}
TORCH_DTYPES = {**INTEGERS, **FLOATS, "BF16": "bfloat16", "BOOL": "bool"}  # by their names in safetensors
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
LARGEST_ARRAYS = 2**32  # bytes; an npz that says it holds more is not one of ours
UNREADABLE = (
    *(ValueError, TypeError, KeyError, EOFError, RuntimeError, MemoryError, SyntaxError, SafetensorError),
    *(struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error),
)  # what damaged files make the libraries raise


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what a bad file does to its reader into an ArtifactError, and what a bad disk does into a StorageError."""
    with storage_faults(path):
        try:
            yield
        except (OSError, *UNREADABLE) as error:
            if isinstance(error, OSError) and error.errno in FAULTS:
                raise
            raise ArtifactError(f"{path}: cannot be read: {error}") from error


def save_tensors(path: Path, tensors: Mapping[str, torch.Tensor], metadata: Mapping[str, str]) -> None:
    """Save tensors of any shape with string metadata in safetensors format.

    Raises ValueError for two entries of metadata or more: the library writes those in an order of its own every time.
    """
    from safetensors.torch import save

    if len(metadata) > 1:
        raise ValueError(f"metadata {', '.join(metadata)}: only one entry gives the same bytes every time")
    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_bytes(path, save(contiguous, metadata=dict(metadata)))


def load_tensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    """Load what `save_tensors` wrote, onto the CPU. Raises ArtifactError naming the file."""
    with reading(path), safe_open(path, framework="pt", device="cpu") as file:
        names = file.keys()
        return {name: file.get_tensor(name) for name in names}, dict(file.metadata() or {})


def tensor_shapes(path: Path) -> Shapes:
    """`name: (dtype, shape)` of what `save_tensors` wrote, without torch. Raises ArtifactError naming the file."""
    with reading(path), safe_open(path, framework="numpy") as file:
        names = file.keys()
        slices = {name: file.get_slice(name) for name in names}
        return {name: (TORCH_DTYPES[part.get_dtype()], tuple(part.get_shape())) for name, part in slices.items()}


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any] | float]) -> None:
    """Save arrays as npz; floating point becomes float32. Raises ValueError for arrays of objects."""
    converted: dict[str, Any] = {}
    for name, value in arrays.items():
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise ValueError(f"{name}: arrays of Python objects cannot be saved")
        converted[name] = array.astype(np.float32) if np.issubdtype(array.dtype, np.floating) else array
    content = io.BytesIO()
    np.savez_compressed(content, **converted)
    write_bytes(path, content.getvalue())


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Load what `save_arrays` wrote; Python objects and false sizes are refused with an ArtifactError."""
    with reading(path):
        content = io.BytesIO(path.read_bytes())
        _shapes(content)
        content.seek(0)
        with np.load(content, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}


def array_shapes(path: Path) -> Shapes:
    """`name: (dtype, shape)` of the arrays of an npz, from their headers alone. Raises ArtifactError."""
    with reading(path):
        return _shapes(io.BytesIO(path.read_bytes()))  # zipfile would take a fault of the disk for one of the file


def _shapes(content: io.BytesIO) -> Shapes:
    with zipfile.ZipFile(content) as archive:
        members = archive.infolist()
        shapes = {member.filename.removesuffix(".npy"): _shape(archive, member) for member in members}
    if len(shapes) < len(members) or sum(member.file_size for member in members) > LARGEST_ARRAYS:
        raise ValueError("a name comes twice, or it says that it holds more than 4 GiB")
    return shapes


def _shape(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> tuple[str, tuple[int, ...]]:
    """Dtype and shape of one array. ValueError where it holds objects or not the bytes that its shape needs."""
    with archive.open(member) as file:
        shape, dtype = _header(file)
        needed = file.tell() + math.prod(shape) * dtype.itemsize
    if dtype.hasobject:
        raise ValueError(f"{member.filename}: Object arrays cannot be loaded")
    if not member.filename.endswith(".npy") or any(length < 0 for length in shape) or needed != member.file_size:
        raise ValueError(f"{member.filename}: {member.file_size} bytes are no array of shape {shape} and type {dtype}")
    return str(dtype), shape


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    if version not in HEADERS:
        raise ValueError(f"npy format {version}")
    shape, _, dtype = HEADERS[version](file)
    return shape, dtype
