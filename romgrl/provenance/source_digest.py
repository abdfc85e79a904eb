"""The code of a stage: every module of the package that it can import, the built extensions and their sources."""

from __future__ import annotations

import ast
import hashlib
import sys
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
CORE = PACKAGE.parent / "cpp"  # in a checkout
DRAWING = ("romgrl.rom.drawing", "romgrl.humanoid.rendering")
KEYS = "romgrl.config."  # says which values a key may have; those that it has are in the key of a stage
PAGE_SUFFIXES = (".css", ".html", ".js")


@cache
def source_digest(entry: str, *, drawing: bool) -> str:
    """SHA-256 over the code of a stage, from the module of its function `module:function`, and of what starts it.

    `drawing`: it makes pictures; an environment that can be drawn computes the same numbers however it looks.
    """
    return digest(stage_files(entry, drawing=drawing))


def stage_files(entry: str, *, drawing: bool, package: Path = PACKAGE, core: Path = CORE) -> dict[str, Path]:
    """The files of a stage by name, as in `source_digest`."""
    modules = (entry.partition(":")[0], "romgrl.pipeline.worker")
    files = {name: path for each in modules for name, path in source_files(each, package, core).items()}
    return {
        name: path for name, path in files.items() if not name.startswith(KEYS) and (drawing or name not in DRAWING)
    }


def digest(files: dict[str, Path]) -> str:
    """SHA-256 over names and contents."""
    lines = (f"{name} {hashlib.sha256(files[name].read_bytes()).hexdigest()}\n" for name in sorted(files))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def source_files(module: str, package: Path = PACKAGE, core: Path = CORE) -> dict[str, Path]:
    """The file of a module, of all modules of the package that it imports, and of theirs, by name.

    With a module comes the table of its name (`human_bands.csv` beside `human_bands.py`), with a package the parts of
    web pages in its folder, with an extension its own sources where there are any, so that a changed line of C++ counts
    before it is built.
    """
    root = package.parent
    files: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = find_module(name, root)
        if path is None or name in files:
            continue
        files[name] = path
        if path.suffix == ".py":
            if path.with_suffix(".csv").is_file():
                files[f"{name}.csv"] = path.with_suffix(".csv")
            if path.name == "__init__.py":
                files |= {f"{name}.{part.name}": part for part in path.parent.iterdir() if part.suffix in PAGE_SUFFIXES}
            waiting += imported(path.read_bytes())
            waiting += [parent for parent in parents(name) if parent not in files]
        elif core.is_dir():
            files |= extension_sources(name, core)
    return files


def extension_sources(name: str, core: Path) -> dict[str, Path]:
    """The sources of an extension `romgrl.ROOM._core`: those of its room, what rooms share, and how they are built."""
    room = name.split(".")[1]
    places = [core / "CMakeLists.txt", *(core / "common").rglob("*"), *(core / room).rglob("*")]
    return {f"cpp/{path.relative_to(core).as_posix()}": path for path in places if path.is_file()}


def find_module(name: str, root: Path) -> Path | None:
    """The file of a dotted name below `root`, Python or built extension; None for what is not a module of ours."""
    path = root.joinpath(*name.split("."))
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return extension(name) if path.with_suffix(".pyi").is_file() else None


def extension(name: str) -> Path | None:
    """Where the built extension lies, which an editable installation keeps elsewhere; imports nothing."""
    directory = str(PACKAGE.parent.joinpath(*name.split(".")[:-1]))
    for finder in sys.meta_path:
        spec = finder.find_spec(name, [directory])
        if spec is not None and spec.origin is not None:
            return Path(spec.origin)
    return None


@cache
def imported(source: bytes) -> list[str]:
    """Dotted names in the absolute imports of a source text; `from a import b` names both a and a.b."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [name for name in names if name.split(".")[0] == PACKAGE.name]


def parents(name: str) -> list[str]:
    """The packages around a module, whose __init__ runs before it."""
    parts = name.split(".")
    return [".".join(parts[:end]) for end in range(1, len(parts))]
