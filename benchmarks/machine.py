"""What a number was measured on: machine, versions and revision."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from romgrl.provenance.versions import git_state, versions


def processor() -> str:
    """Name of the processor as Linux tells it, else as Python does."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def describe() -> dict[str, Any]:
    """Processor, cores, system and versions, and the git revision with "+" where files differ from it."""
    revision, dirty = git_state()
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "versions": versions() | {"mlflow": version("mlflow")},
        "revision": f"{(revision or 'unknown')[:10]}{'+' if dirty else ''}",
    }
