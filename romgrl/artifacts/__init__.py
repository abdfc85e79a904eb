"""Artifacts: payload without pickle, a manifest that proves every byte of it, published whole or not at all."""

from romgrl.artifacts.manifest import MANIFEST, FileRecord, Manifest, read_manifest, write_manifest
from romgrl.artifacts.payload import load_arrays, load_tensors, save_arrays, save_tensors, tensor_shapes
from romgrl.artifacts.publication import publish, set_aside, setting_aside
from romgrl.artifacts.rights import lock_mode, may_write, require_right
from romgrl.artifacts.storage import storage_faults, sync_path, write_bytes
from romgrl.artifacts.verification import open_artifact

__all__ = [
    "MANIFEST",
    "FileRecord",
    "Manifest",
    "load_arrays",
    "load_tensors",
    "lock_mode",
    "may_write",
    "open_artifact",
    "publish",
    "read_manifest",
    "require_right",
    "save_arrays",
    "save_tensors",
    "set_aside",
    "setting_aside",
    "storage_faults",
    "sync_path",
    "tensor_shapes",
    "write_bytes",
    "write_manifest",
]
