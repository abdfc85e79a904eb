"""What an export is written with: a package that only the extra `export` installs."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

from romgrl.config.schema import Config
from romgrl.errors import one_line

NEEDED = "pip install onnx, the extra romgrl[export]"


def onnx_installed(config: Config) -> Iterator[str]:
    """The package onnx can be imported where a student is to be exported."""
    if config.stage != "export":
        return
    try:
        import_module("onnx")
    except ModuleNotFoundError as error:
        told = "onnx is not installed" if error.name == "onnx" else f"onnx cannot be imported: {error}"
        yield f"stage=export: {told}; {NEEDED}"
    except Exception as error:  # of a damaged package, or of one that does not fit another, any
        told = one_line(f"{type(error).__name__}: {error}", 300)
        yield f"stage=export: onnx cannot be imported: {told}; {NEEDED}"
