"""Where the student that ships lies, and how the script of an export is run."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from romgrl.provenance.shipped import PLACE

SHIPPED = PLACE / "student"


def script_of(exported: Path, name: str = "run_policy") -> ModuleType:
    """A script as it lies in the artifact."""
    spec = importlib.util.spec_from_file_location(f"exported_{name}", exported / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run_script(directory: Path, *arguments: str, without: str = "") -> subprocess.CompletedProcess[str]:
    """Run it in its directory, where romgrl, torch and what they need cannot be imported."""
    blocked = ["romgrl", "torch", "gymnasium", "onnx", "hydra", "scipy", *filter(None, [without])]
    run = "runpy.run_path('run_policy.py', run_name='__main__')"
    code = f"import sys, runpy; sys.modules.update(dict.fromkeys({blocked})); sys.argv[0] = 'run_policy.py'; {run}"
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False, encoding="utf-8")


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """The one line that it ended with."""
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    return line


def changed(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change a JSON file."""
    content = json.loads(path.read_text(encoding="utf-8"))
    change(content)
    path.write_text(json.dumps(content), encoding="utf-8")
