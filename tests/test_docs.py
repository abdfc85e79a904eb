"""Every command that the documents show runs: romgrl with stages that take milliseconds, make without doing it."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tests.conftest import Command

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


OPEN = re.compile(r"PATH|NAME|DIRECTORY|\.\.\.|://host|\[")  # what a reader fills in
LAUNCHED = "hydra/launcher="  # other processes, where these stages are not known: tests/faults/test_launchers.py
SEARCH, TRIALS = re.compile(r"=optuna|--config-name tune"), "hydra.sweeper.n_trials="
TRAINED = ("stage=verify", "stage=watch")  # say in one line that nothing is trained yet


def commands(start: str, documents: Sequence[Path] = DOCUMENTS) -> Iterator[str]:
    """Lines of code blocks, and inline code, that begin with `start`; comments cut off."""
    for document in documents:
        text = document.read_text(encoding="utf-8")
        blocks = re.findall(r"```\w*\n(.*?)```", text, flags=re.DOTALL)
        lines = [line for block in blocks for line in block.splitlines()]
        indented = re.findall(r"^ {4}(\S.*)$", text, flags=re.MULTILINE)
        inline = re.findall(r"(?<!`)`([^`\n]+)`(?!`)", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
        for line in (*lines, *indented, *inline):
            shown = re.split(r"#| {2,}", line)[0].strip()
            if re.match(rf"{re.escape(start)}(\s|$)", shown) and not OPEN.search(shown) and LAUNCHED not in shown:
                yield shown


README = sorted(set(commands("python -m romgrl", DOCUMENTS[:1])))
GUIDES = sorted(set(commands("python -m romgrl", DOCUMENTS[1:])) - set(README))
MAKE = sorted(set(commands("make")) - {"make"})


def test_the_readme_shows_its_two_commands_and_four_usages() -> None:
    assert {"make run", "make test"} <= set(MAKE)
    assert len(README) >= 4


@pytest.mark.parametrize("line", [*README, *(pytest.param(line, marks=pytest.mark.slow) for line in GUIDES)])
def test_romgrl(line: str, command: Command) -> None:
    one_seed = ["seed=0"] if "--config-name" in line and " seed=" not in line else []  # of a stored sweep
    torch = {"PYTHONPATH": str(ROOT)} if "pretrained" in line else {}  # what ships is no fake, and is read with it
    arguments = [text for text in shlex.split(line)[3:] if not text.startswith(TRIALS)]
    few = [f"{TRIALS}2"] if SEARCH.search(line) else []
    result = command(*arguments, *one_seed, *few, "tracking=none", **torch)
    if any(word in line for word in TRAINED):
        assert (result.returncode, result.stderr.count("\n")) == (3, 1), result.stderr
    else:
        assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("line", MAKE)
def test_make(line: str) -> None:
    dry = ["make", "-n", *shlex.split(line)[1:]]
    result = subprocess.run(dry, cwd=ROOT, capture_output=True, text=True, check=False, encoding="utf-8")
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", document.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (document.parent / target).exists(), f"{document.name}: {target}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_files_that_are_named_are_there(document: Path) -> None:
    for line in document.read_text(encoding="utf-8").splitlines():
        for named in re.findall(r"(?:romgrl|cpp|conf|tests|sweeps|benchmarks)/[\w./]+\.\w+", line):
            assert (ROOT / named).exists(), f"{document.name}: {named}"
