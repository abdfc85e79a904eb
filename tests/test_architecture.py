"""The arrows of docs/architecture.md: who may import whom, held by reading the sources."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "romgrl").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
BESIDE = [*TESTS, *(ROOT / "docs" / "examples").rglob("*.py")]
PEERS = ROOT / "benchmarks" / ".peers"  # environments of others
BESIDE += [path for path in (ROOT / "benchmarks").rglob("*.py") if not path.is_relative_to(PEERS)]
SHARED = {"helpers", "conftest"}  # what every test may import of tests/
LEARNING = {"algorithms"}
WIRING = {"__main__", "cli", "sweeps"}
LOOSE = {"__init__", "__main__", "errors"}  # what stands beside the rooms
ALLOWED: dict[str, set[str]] = {
    "__init__": set(),
    "errors": set(),
    "config": {"errors"},
    "runtime": set(),
    "gait": {"errors"},
    "rom": {"config", "errors", "gait"},
    "artifacts": {"errors"},
    "algorithms": {"artifacts", "errors", "gait"},
    "humanoid": {"config", "errors", "gait"},
    "provenance": {"artifacts", "config", "errors", "humanoid", "runtime"},
    "report": {"artifacts", "errors", "gait", "provenance", "rom", "runtime"},
    "tracking": {"artifacts", "config", "errors", "provenance", "runtime"},
    "stages": {
        "algorithms",
        "artifacts",
        "config",
        "errors",
        "gait",
        "humanoid",
        "provenance",
        "report",
        "rom",
        "runtime",
    },
    "results": {"artifacts", "config", "errors", "gait", "provenance", "report", "runtime"},
    "cli": {"config", "errors", "gait", "humanoid", "provenance", "report", "rom", "runtime", "tracking"},
    "pipeline": {"artifacts", "cli", "config", "errors", "provenance", "report", "results", "runtime", "tracking"},
    "sweeps": {
        "artifacts",
        "cli",
        "config",
        "errors",
        "pipeline",
        "provenance",
        "report",
        "results",
        "runtime",
        "tracking",
    },
    "pretrained": {"artifacts", "cli", "config", "errors", "provenance", "report", "results", "runtime"},
    "__main__": {"cli", "config", "sweeps"},
}  # in an order in which each room imports only rooms above it


SAME_CONCEPT = {
    "main": "the way into a program",
    "run": "what a command, a job or a stage does",
    "serve": "what a process does that another one starts",
    "STAGES": "names in the schema, records in the graph; a test holds them equal",
    "SKELETONS": "names in the schema, records in the room; a test holds them equal",
    "Discriminator": "its settings and itself",
    "GRAVITY": "of rooms that know nothing of each other",
    "CONFIDENCE": "of intervals",
    "RESAMPLES": "of intervals",
    "SEED": "of intervals",
    **dict.fromkeys(("Array", "Float32", "Floats", "Image", "Policy", "Rows"), "the type of an argument"),
}  # public names that more than one room defines, and what they are in each


def room(path: Path) -> str:
    """The top-level module or package that a file belongs to."""
    first = path.relative_to(ROOT / "romgrl").parts[0]
    return first.removesuffix(".py")


def imports(path: Path) -> set[str]:
    """Every imported module, dotted; relative imports made absolute."""
    found: set[str] = set()
    package = path.relative_to(ROOT).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1]] if node.level else []
            module = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            found |= {f"{module}.{alias.name}" if module in {"romgrl", "tests"} else module for alias in node.names}
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_arrows(path: Path) -> None:
    own = room(path)
    used = {name.split(".")[1] for name in imports(path) if name.startswith("romgrl.")}
    assert used <= ALLOWED[own] | {own}, f"{own} must not import {used - ALLOWED[own]}"


def test_rooms_import_only_what_stands_above_them() -> None:
    """So no two rooms need each other."""
    order = list(ALLOWED)
    assert not [
        (own, other) for own, others in ALLOWED.items() for other in others if order.index(other) >= order.index(own)
    ]


def test_only_the_way_in_and_errors_stand_loose() -> None:
    assert {path.stem for path in (ROOT / "romgrl").glob("*.py")} == LOOSE
    assert {room(path) for path in SOURCES} == ALLOWED.keys()


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_each_file_says_what_it_is(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_outside_libraries(path: Path) -> None:
    own, roots = room(path), {name.split(".")[0] for name in imports(path)}
    if path.parent != ROOT / "romgrl" / "tracking" / "sending":
        assert "mlflow" not in roots
    if own not in WIRING:
        assert not roots & {"hydra", "omegaconf"}
    if path.name != "hydra_internals.py":
        assert not [name for name in imports(path) if name.startswith("hydra._internal")]
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


def test_files_beside_the_package_stay_small() -> None:
    lines = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in BESIDE}
    assert not {name for name, count in lines.items() if count > 300}


def test_nothing_is_suppressed_where_no_checker_looks() -> None:
    """mypy reads the package and the benchmarks alone, so a comment that silences it elsewhere says what is not so."""
    silencer = "type" + ": ignore"
    assert not [str(path.relative_to(ROOT)) for path in BESIDE if silencer in path.read_text(encoding="utf-8")]


def test_tests_share_helpers_and_no_rooms() -> None:
    """So a test can be moved or split without a look at other rooms: what others use lies in tests/helpers."""
    foreign = {}
    for path in TESTS:
        inside = path.relative_to(ROOT / "tests").parts
        own = {inside[0]} if len(inside) > 1 else set()
        used = {name.split(".")[1] for name in imports(path) if name.startswith("tests.")}
        foreign[str(path.relative_to(ROOT))] = used - SHARED - own
    assert not {name for name, rooms in foreign.items() if rooms}


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


def public_names(path: Path) -> set[str]:
    """Functions, classes and constants that a module defines for others."""
    names: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return {name for name in names if not name.startswith("_")}


def test_a_name_is_one_thing() -> None:
    rooms: dict[str, set[str]] = {}
    for path in SOURCES:
        for name in public_names(path):
            rooms.setdefault(name, set()).add(room(path))
    assert {name for name, where in rooms.items() if len(where) > 1} == SAME_CONCEPT.keys()
