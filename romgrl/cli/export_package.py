"""What an export is written with: a package that only the extra `export` installs."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec

from romgrl.config.schema import Config


def export_package(config: Config) -> Iterator[str]:
    """The package onnx is there where a student is to be exported."""
    if config.stage == "export" and find_spec("onnx") is None:
        yield "stage=export: onnx is not installed; pip install onnx, the extra romgrl[export]"
