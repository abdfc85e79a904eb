"""The arrows of docs/architecture.md: who may import whom, held by reading the sources."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "romgrl").rglob("*.py"))
LEARNING = {"algorithms", "networks", "buffers", "normalizer", "lanes", "limits"}
WORLDS = {"rom", "humanoid"}
WIRING = {"__main__", "command_line", "composition", "loading", "sweep", "config_docs", "targets", "draws"}
WIRING |= {"command", "hydra_settings", "sweep_directory", "typed_text", "whole_paths"}
BELOW_STAGES = (
    LEARNING
    | WORLDS
    | {"gait", "report", "artifacts", "checkpoint", "progress", "config", "errors", "interruption", "stages"}
    | {"pretrained"}
)
ALLOWED = {
    "algorithms": LEARNING | {"artifacts", "errors"},
    "networks": {"errors"},
    "buffers": {"errors"},
    "normalizer": {"errors"},
    "lanes": set(),
    "limits": {"errors"},
    "rom": {"config", "errors", "rom"},
    "humanoid": {"config", "errors", "humanoid"},
    "gait": {"errors", "gait"},
    "report": {"artifacts", "config", "display", "errors", "gait", "humanoid", "report", "rom"},
    "results": {
        "addresses",
        "artifacts",
        "config",
        "display",
        "errors",
        "gait",
        "keys",
        "pretrained",
        "report",
        "results",
        "summary",
        "surroundings",
        "validation",
    },
    "artifacts": {"errors"},
    "checkpoint": {"artifacts", "errors"},
    "interruption": set(),
    "progress": {"errors"},
    "config": set(),
    "display": set(),
    "errors": set(),
    "stages": BELOW_STAGES,
    "validation": {"config"},
    "misfits": {"config", "errors", "gait", "humanoid", "places", "pretrained", "rom", "validation"},
    "places": {"addresses", "config", "journal", "validation"},
    "keys": {"config", "errors", "humanoid", "pretrained", "provenance", "sources", "validation"},
    "pretrained": {
        "artifacts",
        "composition",
        "config",
        "display",
        "errors",
        "keys",
        "progress",
        "report",
        "results",
        "surroundings",
        "validation",
    },
    "sources": set(),
    "locks": {"artifacts"},
    "workspace": {"artifacts", "checkpoint"},
    "provenance": set(),
    "summary": {"gait"},
    "titles": {"artifacts", "config", "keys", "progress", "results", "summary", "validation"},
    "journal": set(),
    "recorder": {"addresses", "artifacts", "errors", "journal", "surroundings", "tracking_process"},
    "tracking": {"addresses", "artifacts", "display", "errors", "journal", "recorder", "summary"},
    "remote": {"artifacts", "errors", "recorder"},
    "tracking_process": {"addresses"},
    "pipeline": {
        "config",
        "cores",
        "interruption",
        "job",
        "journal",
        "keys",
        "misfits",
        "pretrained",
        "progress",
        "recorder",
        "results",
        "summary",
        "titles",
        "watching",
        "worker",
    },
    "watching": {"artifacts", "config", "errors", "interruption", "job", "progress", "recorder", "worker", "workspace"},
    "job": {
        "artifacts",
        "config",
        "errors",
        "keys",
        "locks",
        "progress",
        "provenance",
        "recorder",
        "remote",
        "summary",
        "titles",
        "worker",
        "workspace",
    },
    "worker": {"artifacts", "config", "display", "errors", "interruption", "progress"},
    "composition": {"config", "draws", "errors", "hydra_settings", "misfits", "targets", "validation"},
    "draws": set(),
    "loading": {"composition", "targets", "typed_text", "validation"},
    "command_line": {"addresses", "composition", "errors", "loading", "surroundings", "typed_text", "validation"},
    "targets": {"config", "typed_text", "validation", "whole_paths"},
    "launch": {"config", "cores", "display", "errors", "interruption", "pipeline", "progress", "results"},
    "endings": {"errors"},
    "sweep": {
        "artifacts",
        "cores",
        "errors",
        "interruption",
        "journal",
        "launch",
        "loading",
        "pipeline",
        "provenance",
        "recorder",
        "results",
        "sweep_directory",
    },
    "config_docs": {"composition", "config", "validation"},
    "__main__": {"command"},
    "command": {"command_line", "composition", "display", "endings", "errors", "launch", "usage"},
    "hydra_settings": {"places", "validation"},
    "usage": set(),
    "__init__": set(),
    "addresses": set(),
    "typed_text": {"addresses", "validation"},
    "whole_paths": {"addresses"},
    "sweep_directory": {"addresses", "errors", "launch", "validation"},
    "cores": set(),
    "surroundings": set(),
}


def room(path: Path) -> str:
    """The top-level module or package that a file belongs to."""
    first = path.relative_to(ROOT / "romgrl").parts[0]
    return first.removesuffix(".py")


def imports(path: Path) -> set[str]:
    """Every imported module, dotted; relative imports made absolute."""
    found: set[str] = set()
    package = ["romgrl", *path.relative_to(ROOT / "romgrl").parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1]] if node.level else []
            module = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            found |= {f"{module}.{alias.name}" if module == "romgrl" else module for alias in node.names}
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_arrows(path: Path) -> None:
    own = room(path)
    used = {name.split(".")[1] for name in imports(path) if name.startswith("romgrl.")}
    assert used <= ALLOWED[own] | {own}, f"{own} must not import {used - ALLOWED[own]}"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_outside_libraries(path: Path) -> None:
    own, roots = room(path), {name.split(".")[0] for name in imports(path)}
    if own != "tracking":
        assert "mlflow" not in roots
    if own not in WIRING:
        assert not roots & {"hydra", "omegaconf"}
    if own in LEARNING:
        assert not roots & {"gymnasium", "mujoco"}
    assert not roots & {"pickle", "joblib", "dill", "shelve"}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_and_functions_stay_small(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 300
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 65, f"{node.name} is too long"


def test_entry_point_is_under_50_lines() -> None:
    assert len((ROOT / "romgrl" / "__main__.py").read_text(encoding="utf-8").splitlines()) < 50


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    heavy = "{'torch', 'mujoco', 'mlflow', 'matplotlib', 'pandas'}"
    script = (
        "import sys, time, atexit; start = time.process_time(); sys.argv = ['romgrl', '--help'];"
        f"atexit.register(lambda: print(time.process_time() - start, {heavy} & set(sys.modules)));"
        "from romgrl.__main__ import main; main()"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True, encoding="utf-8"
    )
    seconds, modules = result.stdout.splitlines()[-1].split(maxsplit=1)
    assert modules == "set()"
    assert float(seconds) < 1.5
    for word in ("stage=teacher", "-m speed=1,4", "experiment=paper", "hours", "fast_sac", "docs/configuration.md"):
        assert word in result.stdout
