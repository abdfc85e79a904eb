"""What made an artifact: versions of the libraries that matter and the git revision of the sources."""

from __future__ import annotations

import os
import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from threading import Event

import romgrl

COMPUTING = ("python", "romgrl", "torch", "numpy", "mujoco")
GIT_SECONDS = 10.0  # that git may take; one that took longer is not asked again
OTHER_REPOSITORY = ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "GIT_COMMON_DIR", "GIT_OBJECT_DIRECTORY")
LIBRARIES = ("torch", "numpy", "mujoco", "gymnasium", "safetensors")

git_hung = Event()


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
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def git_state() -> tuple[str | None, bool | None]:
    """Revision and whether files differ from it; (None, None) outside a checkout of this project."""
    root = root_of_sources()
    if git_hung.is_set() or not (root / ".git").exists():
        return None, None
    try:
        revision = _git(root, "rev-parse", "HEAD")
        return revision, bool(_git(root, "status", "--porcelain"))
    except subprocess.TimeoutExpired:
        git_hung.set()
        return None, None
    except (OSError, ValueError, subprocess.SubprocessError):
        return None, None


def root_of_sources() -> Path:
    """Directory that the package lies in; of a checkout, its root."""
    return Path(romgrl.__file__).resolve().parent.parent


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "--no-optional-locks", "-C", str(root), *arguments]
    environment = {name: value for name, value in os.environ.items() if name not in OTHER_REPOSITORY}
    done = subprocess.run(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        check=True,
        timeout=GIT_SECONDS,
    )
    return done.stdout.strip()
