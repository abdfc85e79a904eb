"""What made an artifact: versions of the libraries that matter and the git revision of the sources."""

from __future__ import annotations

import os
import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import romgrl

COMPUTING = ("python", "romgrl", "torch", "numpy", "mujoco")
LIBRARIES = ("torch", "numpy", "mujoco", "gymnasium", "safetensors")


def versions() -> dict[str, str]:
    """Versions of Python, of this package and of the libraries that results depend on."""
    libraries = {library: installed(library) for library in LIBRARIES}
    return {"python": platform.python_version(), "romgrl": romgrl.__version__, **libraries}


@cache
def installed(library: str) -> str:
    """The version of a library; it is looked up in the files of the installation, once in a process."""
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"


def computing_versions() -> dict[str, str]:
    """The versions that decide what a stage computes; of Python's, the first two numbers."""
    found = versions()
    found["python"] = found["python"].rpartition(".")[0]
    return {name: found[name] for name in COMPUTING}


def machine() -> dict[str, str | int]:
    """The processor and the cores of this machine, without its name."""
    return {"processor": processor(), "cores": os.cpu_count() or 1, "system": platform.system()}


def processor() -> str:
    """Model of the processor, as /proc/cpuinfo has it where there is one."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(errors="replace").splitlines() if path.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def git_state() -> tuple[str | None, bool | None]:
    """Revision and whether files differ from it; (None, None) outside a checkout of this project."""
    root = Path(romgrl.__file__).resolve().parent.parent
    if not (root / ".git").exists():
        return None, None
    try:
        revision = _git(root, "rev-parse", "HEAD")
        return revision, bool(_git(root, "status", "--porcelain"))
    except (OSError, subprocess.SubprocessError):
        return None, None


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
