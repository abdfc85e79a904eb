"""Puts sanitized extensions in the place of the usual ones; Python imports this at its start where it is on the path.

`ROMGRL_SANITIZED` is the directory that they were built in.
"""

import importlib.util
import os
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path

BUILT = Path(os.environ["ROMGRL_SANITIZED"]).resolve()
PLACES = {"romgrl.rom._core": BUILT, "romgrl.humanoid._core": BUILT / "humanoid"}


class Finder:
    """Finds the sanitized extensions before anything else does."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if name not in PLACES:
            return None
        (built,) = PLACES[name].glob("_core*.so")
        return importlib.util.spec_from_file_location(name, built)


sys.meta_path.insert(0, Finder)
