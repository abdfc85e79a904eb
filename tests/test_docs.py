"""Every command that the documents show runs: romgrl with stages that take milliseconds, make without doing it."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import Command

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands(start: str) -> Iterator[str]:
    """Lines of code blocks, and inline code, that begin with `start`; comments cut off."""
    for document in DOCUMENTS:
        text = document.read_text()
        blocks = re.findall(r"```\w*\n(.*?)```", text, flags=re.DOTALL)
        lines = [line for block in blocks for line in block.splitlines()]
        inline = re.findall(r"(?<!`)`([^`\n]+)`(?!`)", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
        for line in (*lines, *inline):
            shown = line.split("#")[0].strip()
            if re.match(rf"{re.escape(start)}(\s|$)", shown) and "PATH" not in shown:
                yield shown


ROMGRL = sorted(set(commands("python -m romgrl")))
MAKE = sorted(set(commands("make")) - {"make"})


def test_the_readme_shows_its_two_commands_and_four_usages() -> None:
    assert {"make run", "make test"} <= set(MAKE)
    assert len(ROMGRL) >= 4


@pytest.mark.parametrize("line", ROMGRL)
def test_romgrl(line: str, command: Command) -> None:
    one_seed = ["seed=0"] if "--config-name" in line else []  # of a stored sweep
    result = command(*shlex.split(line)[3:], *one_seed, "tracking=none")
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("line", MAKE)
def test_make(line: str) -> None:
    dry = ["make", "-n", *shlex.split(line)[1:]]
    result = subprocess.run(dry, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", document.read_text()):
        if not target.startswith("http"):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
