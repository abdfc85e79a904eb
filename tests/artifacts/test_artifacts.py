"""Artifacts come back as they were saved, and anything that was changed is refused by name."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from romgrl.artifacts import (
    load_arrays,
    load_tensors,
    open_artifact,
    save_arrays,
    save_tensors,
    tensor_shapes,
)
from romgrl.errors import ArtifactError
from tests.helpers.artifacts import describe, whole
from tests.helpers.damage import forge


@pytest.fixture
def artifact(tmp_path: Path) -> Path:
    return whole(tmp_path / "artifact")


def test_round_trip(artifact: Path) -> None:
    tensors, metadata = load_tensors(artifact / "policy.safetensors")
    assert torch.equal(tensors["w"], torch.arange(6.0).reshape(2, 3))
    assert metadata == {"network": "{}"}
    arrays = load_arrays(artifact / "reference.npz")
    assert arrays["features"].dtype == np.float32
    assert arrays["dt"].dtype == np.float32
    assert arrays["dt"] == np.float32(1 / 30)
    assert arrays["episode"].tolist() == list(range(7))


def test_metadata_that_would_not_give_the_same_bytes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a, b: only one entry"):
        save_tensors(tmp_path / "x.safetensors", {"w": torch.ones(2)}, {"a": "1", "b": "2"})


def test_dtypes_without_torch_are_those_of_torch(tmp_path: Path) -> None:
    names = ["float16", "bfloat16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "bool"]
    tensors = {name: torch.ones(2, 3).to(getattr(torch, name)) for name in names} | {"scalar": torch.tensor(1.0)}
    save_tensors(tmp_path / "x.safetensors", tensors, {})
    expected = {name: (name, (2, 3)) for name in names} | {"scalar": ("float32", ())}
    assert tensor_shapes(tmp_path / "x.safetensors") == expected


def test_manifest_describes_every_file(artifact: Path) -> None:
    manifest = open_artifact(artifact, stage="teacher")
    assert set(manifest.files) == {"policy.safetensors", "reference.npz", "curve.csv", "figures/a.txt"}
    assert manifest.files["policy.safetensors"].arrays == {"w": ("float32", (2, 3))}
    assert manifest.files["reference.npz"].arrays["features"] == ("float32", (7, 5))
    assert (manifest.wall_time, manifest.config) == (1.5, {"seed": 0, "teacher.speed": 4.0})


def test_digest_depends_on_the_payload_only(artifact: Path) -> None:
    before = describe(artifact).digest
    assert describe(artifact).digest == before
    (artifact / "curve.csv").write_text("step,loss\n1,3\n", encoding="utf-8")
    assert describe(artifact).digest != before


def truncate(directory: Path) -> None:
    path = directory / "reference.npz"
    path.write_bytes(path.read_bytes()[:-1])


def flip(directory: Path) -> None:
    path = directory / "policy.safetensors"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def swap(directory: Path) -> None:
    (directory / "figures" / "a.txt").rename(directory / "x")
    (directory / "curve.csv").rename(directory / "figures" / "a.txt")
    (directory / "x").rename(directory / "curve.csv")


def edit(directory: Path, change: Callable[[dict[str, object]], object]) -> None:
    path = directory / "manifest.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "truncated": (truncate, "reference.npz: does not have the SHA-256"),
    "one bit": (flip, "policy.safetensors: does not have the SHA-256"),
    "swapped": (swap, "curve.csv: does not have the SHA-256"),
    "missing": (lambda directory: (directory / "curve.csv").unlink(), "curve.csv: missing"),
    "extra": (lambda directory: (directory / "more.csv").touch(), "more.csv: not listed"),
    "no manifest": (
        lambda directory: (directory / "manifest.json").unlink(),
        "manifest.json: missing; this is not a fin",
    ),
    "half a manifest": (
        lambda directory: (directory / "manifest.json").write_text("{", encoding="utf-8"),
        "manifest.json: cannot be read",
    ),
    "a list": (
        lambda directory: (directory / "manifest.json").write_text("[]", encoding="utf-8"),
        "manifest.json: cannot be read",
    ),
    "entry removed": (
        lambda directory: edit(directory, lambda m: m["files"].popitem()),
        "manifest.json: does not have its own",
    ),
    "other shape": (
        lambda directory: forge(directory, lambda m: m["files"]["reference.npz"]["arrays"].update(dt=["int8", []])),
        "reference.npz: arrays do not have the shapes",
    ),
    "future format": (lambda directory: forge(directory, lambda m: m.update(format=3)), "format 3, this version reads"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(artifact: Path, name: str) -> None:
    damage, message = DAMAGE[name]
    damage(artifact)
    with pytest.raises(ArtifactError, match=message.replace(".", r"\.")):
        open_artifact(artifact)


@pytest.mark.parametrize("name", ["run_policy.py", "policy.onnx", "model.xml"])
def test_files_for_elsewhere_are_those_of_an_export_alone(tmp_path: Path, name: str) -> None:
    """Neither written nor read in an artifact of another stage, nor taken where it says that it is an export."""
    (tmp_path / name).write_text("", encoding="utf-8")
    with pytest.raises(ArtifactError, match=rf"manifest\.json: {name} is none of the kinds csv, .*, txt$"):
        describe(tmp_path, stage="student")
    describe(tmp_path, stage="export")
    assert [*open_artifact(tmp_path, stage="export").files] == [name]
    with pytest.raises(ArtifactError, match="made by stage export, expected student"):
        open_artifact(tmp_path, stage="student")
    forge(tmp_path, lambda manifest: manifest.update(stage="student"))
    with pytest.raises(ArtifactError, match=rf"manifest\.json: {name} is none of the kinds csv, .*, txt$"):
        open_artifact(tmp_path, stage="student")


def test_another_stage_is_refused(artifact: Path) -> None:
    with pytest.raises(ArtifactError, match="made by stage teacher, expected student"):
        open_artifact(artifact, stage="student")


def test_another_key_is_refused(artifact: Path) -> None:
    assert open_artifact(artifact, key="key").key == "key"
    with pytest.raises(ArtifactError, match="made by key key, expected other"):
        open_artifact(artifact, key="other")


def test_pickles_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "objects.npz", x=np.array([{"a": 1}], dtype=object))
    (tmp_path / "policy.safetensors").write_bytes(pickle.dumps({"w": 1}))
    (tmp_path / "plain.npz").write_bytes(pickle.dumps({"w": 1}))
    with pytest.raises(ArtifactError, match=r"policy\.safetensors: cannot be read"):
        tensor_shapes(tmp_path / "policy.safetensors")
    for name, load in (("objects.npz", load_arrays), ("plain.npz", load_arrays), ("policy.safetensors", load_tensors)):
        with pytest.raises(ArtifactError, match=f"{name}: cannot be read"):
            load(tmp_path / name)
    with pytest.raises(ValueError, match="x: arrays of Python objects"):
        save_arrays(tmp_path / "y.npz", {"x": np.array([object()])})


def test_a_failed_save_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    save_tensors(path, {"w": torch.ones(2)}, {})
    shared = torch.ones(4)
    with pytest.raises(RuntimeError):
        save_tensors(path, {"a": shared, "b": shared}, {})
    assert torch.equal(load_tensors(path)[0]["w"], torch.ones(2))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
