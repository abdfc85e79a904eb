"""A small artifact with one file of each kind, made at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from romgrl.artifacts import Manifest, save_arrays, save_tensors, write_manifest


def fill(directory: Path) -> None:
    """One payload file of each kind."""
    (directory / "figures").mkdir(parents=True)
    save_tensors(directory / "policy.safetensors", {"w": torch.arange(6.0).reshape(2, 3)}, {"network": "{}"})
    save_arrays(directory / "reference.npz", {"features": np.ones((7, 5)), "dt": 1 / 30, "episode": np.arange(7)})
    (directory / "curve.csv").write_text("step,loss\n1,2\n", encoding="utf-8")
    (directory / "figures" / "a.txt").write_text("figure", encoding="utf-8")


def describe(directory: Path, *, stage: str = "teacher", key: str = "key") -> Manifest:
    """Write its manifest."""
    return write_manifest(
        directory,
        stage=stage,
        key=key,
        config={"seed": 0, "teacher.speed": 4.0},
        inputs={},
        versions={"torch": "1"},
        revision=None,
        dirty=None,
        seed=0,
        wall_time=1.5,
    )


def whole(directory: Path) -> Path:
    """The directory, filled and described."""
    fill(directory)
    describe(directory)
    return directory
